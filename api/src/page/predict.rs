//! The page that shows what checkpoints predict for a stored trajectory.

use askama::Template;
use axum::extract::State;
use axum::response::Response;
use reports::Table;
use spec::{DataSource, JobSpec, ValidationMetric};
use wire::{Checkpoint, Dataset, DatasetState, DrawnPredictions, Job, Listed as _, Warning};

use crate::app::App;
use crate::app::listing::ListRequest;
use crate::app::trajectory_predictions::PredictionsRequest;
use crate::charts;
use crate::error::ApiError;
use crate::extract::QueryPairs;
use crate::page::answer::{PageError, html};
use crate::page::text;

#[derive(Template)]
#[template(path = "predict.html")]
struct PredictPage {
    title: String,
    fields: Fields,
    datasets: Vec<Choice>,
    checkpoints: Vec<Choice>,
    /// The largest index of a trajectory.
    last: u64,
    previous: Option<String>,
    next: Option<String>,
    /// Why there is no prediction; empty if there is one.
    problem: String,
    tables: Vec<Table>,
    figure: String,
    warnings: Vec<String>,
    /// The address of the same numbers as JSON.
    numbers: String,
}

/// A dataset or a checkpoint to choose.
struct Choice {
    id: i64,
    name: String,
    is_chosen: bool,
    /// Whether it is a checkpoint that draws its predictions in steps.
    is_sampled: bool,
}

/// The fields of the form.
struct Fields {
    dataset: Option<i64>,
    trajectory: u64,
    request: PredictionsRequest,
}

/// Datasets and checkpoints in the form, the newest ones, beside those that are chosen.
const CHOICES: usize = 20;

pub async fn show(State(app): State<App>, pairs: QueryPairs) -> Result<Response, PageError> {
    let pairs = pairs.filled();
    let mut fields = Fields::read(&app, &pairs).await?;
    let newest = vec![("limit".to_owned(), CHOICES.to_string())];
    let mut datasets =
        app.list::<Dataset>(&ListRequest::read(&Dataset::LIST, &newest)?).await?.datasets;
    datasets.retain(|dataset| dataset.state == DatasetState::Complete && dataset.trajectories > 0);
    let mut checkpoints =
        app.list::<Checkpoint>(&ListRequest::read(&Checkpoint::LIST, &newest)?).await?.checkpoints;
    for &id in &fields.request.checkpoints {
        if checkpoints.iter().all(|checkpoint| checkpoint.id != id) {
            checkpoints.insert(0, app.checkpoint(id).await?);
        }
    }
    if fields.request.checkpoints.is_empty() {
        fields.request.checkpoints.extend(checkpoints.first().map(|checkpoint| checkpoint.id));
    }
    if fields.dataset.is_none() {
        let first = fields.request.checkpoints.first();
        let first = checkpoints.iter().find(|checkpoint| Some(&checkpoint.id) == first);
        // Data that the checkpoint was not trained on say more.
        let of_checkpoint = match first {
            Some(checkpoint) => match app.dataset_of_evaluation(checkpoint).await? {
                None => app.dataset_of_training(checkpoint).await?,
                evaluated => evaluated,
            },
            None => None,
        };
        fields.dataset = of_checkpoint.or(datasets.first().map(|dataset| dataset.id));
    }
    if let Some(id) = fields.dataset
        && datasets.iter().all(|dataset| dataset.id != id)
    {
        datasets.insert(0, app.dataset(id).await?);
    }
    let chosen = datasets.iter().find(|dataset| Some(dataset.id) == fields.dataset);
    let last = chosen.map_or(0, |dataset| dataset.trajectories.saturating_sub(1));
    let shown = match fields.dataset {
        Some(dataset) => Shown::of(&app, dataset, &fields).await?,
        None => Shown::problem("There is no complete dataset yet.".to_owned()),
    };
    let trainings: Vec<i64> = checkpoints.iter().map(|checkpoint| checkpoint.job).collect();
    let names = app.result_names(trainings.iter().copied()).await?;
    let trainings = app.jobs_by_id(&trainings).await?;
    let index = fields.trajectory;
    let page = PredictPage {
        title: match fields.dataset {
            Some(dataset) => format!("Predictions of trajectory {index} of dataset {dataset}"),
            None => "Predictions".to_owned(),
        },
        previous: index.checked_sub(1).map(|index| fields.address("/predict", index)),
        next: index
            .checked_add(1)
            .filter(|next| *next <= last)
            .map(|i| fields.address("/predict", i)),
        datasets: datasets
            .iter()
            .map(|dataset| Choice {
                id: dataset.id,
                name: format!("{} {}", dataset.id, dataset.name),
                is_chosen: Some(dataset.id) == fields.dataset,
                is_sampled: false,
            })
            .collect(),
        checkpoints: checkpoints
            .iter()
            .map(|checkpoint| Choice {
                id: checkpoint.id,
                name: name(checkpoint, names.get(&checkpoint.job)),
                is_chosen: fields.request.checkpoints.contains(&checkpoint.id),
                is_sampled: trainings.get(&checkpoint.job).is_some_and(is_sampled),
            })
            .collect(),
        last,
        numbers: fields.address(
            &format!(
                "/v1/datasets/{}/trajectories/{index}/predictions",
                fields.dataset.unwrap_or_default()
            ),
            index,
        ),
        fields,
        problem: shown.problem,
        tables: shown.tables,
        figure: shown.figure,
        warnings: shown.warnings,
    };
    Ok(html(&page)?)
}

/// Whether the model of a training has a sampler. Another version may have stored the spec.
fn is_sampled(training: &Job) -> bool {
    let spec = serde_json::from_value(training.spec.clone());
    matches!(spec, Ok(JobSpec::Train(spec)) if spec.model.sampler().is_some())
}

/// A checkpoint to choose.
pub struct CheckpointChoice {
    pub id: i64,
    pub name: String,
}

/// The newest checkpoints.
///
/// # Errors
/// When the database fails.
pub async fn newest_checkpoints(app: &App) -> Result<Vec<CheckpointChoice>, ApiError> {
    let newest = [("limit".to_owned(), CHOICES.to_string())];
    let found = app.list::<Checkpoint>(&ListRequest::read(&Checkpoint::LIST, &newest)?).await?;
    let names = app.result_names(found.checkpoints.iter().map(|checkpoint| checkpoint.job)).await?;
    let choice = |checkpoint: &Checkpoint| CheckpointChoice {
        id: checkpoint.id,
        name: name(checkpoint, names.get(&checkpoint.job)),
    };
    Ok(found.checkpoints.iter().map(choice).collect())
}

/// A checkpoint with what says which one it is, such as the name of its run.
fn name(checkpoint: &Checkpoint, run: Option<&String>) -> String {
    let architecture = &checkpoint.architecture;
    let aliases = checkpoint.aliases.iter().map(|alias| format!("@{alias}"));
    let mut parts = vec![match &checkpoint.name {
        Some(name) => format!("{} {name}, {architecture}", checkpoint.id),
        None => format!("{} {architecture}", checkpoint.id),
    }];
    parts.extend(aliases);
    let named = run.map_or(String::new(), |name| format!("{name}, "));
    parts.push(format!("{named}run {}, step {}", checkpoint.run, text::count(checkpoint.step)));
    parts.extend(checkpoint.marks().into_iter().map(str::to_owned));
    let rmse_deg = checkpoint.metrics.get(ValidationMetric::RmseDeg.key());
    parts.extend(rmse_deg.map(|rmse| format!("{}°", text::degrees(*rmse))));
    parts.join(" · ")
}

/// The part of the page below its form.
#[derive(Default)]
struct Shown {
    problem: String,
    tables: Vec<Table>,
    figure: String,
    warnings: Vec<String>,
}

impl Shown {
    fn problem(problem: String) -> Self {
        Self { problem, ..Self::default() }
    }

    /// A refused question is said beside the form, which keeps its fields.
    async fn of(app: &App, dataset: i64, fields: &Fields) -> Result<Self, ApiError> {
        let found = app.predict_trajectory(dataset, fields.trajectory, &fields.request).await;
        let predictions = match found {
            Ok(predictions) => predictions,
            Err(error @ (ApiError::Question(_) | ApiError::Live(_) | ApiError::NoModels)) => {
                return Ok(Self::problem(error.to_string()));
            }
            // Another trajectory or checkpoint may be whole.
            Err(error @ (ApiError::Damaged { .. } | ApiError::ShardUnreadable { .. })) => {
                error.log();
                return Ok(Self::problem(error.to_string()));
            }
            Err(error) => return Err(error),
        };
        let names = app.names_in_evaluations(&predictions).await?;
        let warnings = predictions.predictions.iter().flat_map(|prediction| {
            let named = prediction.warnings.iter().map(|w| w.clone().of(&prediction.name));
            Warning::sentences(&named.collect::<Vec<_>>(), 1, "trajectories")
        });
        Ok(Self {
            problem: String::new(),
            warnings: warnings.collect(),
            figure: charts::predictions_svg(&predictions, &names)?,
            tables: vec![reports::trajectory_predictions::table(&predictions)],
        })
    }
}

impl Fields {
    async fn read(app: &App, pairs: &[(String, String)]) -> Result<Self, ApiError> {
        let request = app.predictions_request(pairs).await?;
        let mut fields = Self { dataset: None, trajectory: 0, request };
        for (name, value) in pairs {
            let refused = |allowed: &str| ApiError::parameter(name, value, allowed);
            match name.as_str() {
                "dataset" => {
                    let id = value.parse().map_err(|_| refused("the id of a dataset"))?;
                    fields.dataset = Some(id);
                }
                "trajectory" => {
                    fields.trajectory =
                        value.parse().map_err(|_| refused("a trajectory's index, from 0"))?;
                }
                _ => {}
            }
        }
        Ok(fields)
    }

    /// The page, or the operation of the API, that asks the same about another trajectory.
    fn address(&self, path: &str, trajectory: u64) -> String {
        let PredictionsRequest { checkpoints, begin, samples, steps, seed } = &self.request;
        let ids: Vec<String> = checkpoints.iter().map(i64::to_string).collect();
        let is_page = path == "/predict";
        let mut query = Vec::new();
        query.extend(self.dataset.filter(|_| is_page).map(|id| format!("dataset={id}")));
        query.extend(is_page.then(|| format!("trajectory={trajectory}")));
        query.extend((!ids.is_empty()).then(|| format!("checkpoint={}", ids.join(","))));
        query.extend(begin.map(|begin| format!("begin={begin}")));
        query.extend(samples.map(|samples| format!("samples={samples}")));
        query.extend(steps.map(|steps| format!("steps={steps}")));
        query.extend((*seed != 0).then(|| format!("seed={seed}")));
        format!("{path}?{}", query.join("&"))
    }
}

/// The addresses of this page for scenarios of an evaluation.
pub struct Viewers {
    /// Without a trajectory.
    fields: Fields,
}

impl Viewers {
    /// `None` if the trajectories of the evaluation or its checkpoints are not stored.
    pub async fn of(
        app: &App,
        evaluation: &Job,
        drawn: &DrawnPredictions,
    ) -> Result<Option<Self>, ApiError> {
        let spec = serde_json::from_value(evaluation.spec.clone());
        let (dataset, begin) = match spec {
            Ok(JobSpec::Evaluate(spec)) => match spec.data {
                DataSource::Digest(digest) => {
                    (app.dataset_of_digest(digest).await?, spec.rounds() + spec.context)
                }
                _ => return Ok(None),
            },
            _ => return Ok(None),
        };
        let mut checkpoints = Vec::new();
        for predictor in &drawn.predictors {
            checkpoints.extend(app.drawn_checkpoint(predictor).await?);
        }
        if dataset.is_none() || checkpoints.is_empty() {
            return Ok(None);
        }
        let begin = Some(begin as usize);
        let request = PredictionsRequest { checkpoints, begin, ..PredictionsRequest::default() };
        Ok(Some(Self { fields: Fields { dataset, trajectory: 0, request } }))
    }

    /// The address for a trajectory; `None` if the evaluation added noise to it.
    pub fn address(&self, trajectory: u64, position_noise_rad: f64) -> Option<String> {
        (position_noise_rad == 0.0).then(|| self.fields.address("/predict", trajectory))
    }
}
