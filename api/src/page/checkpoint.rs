//! The page of a checkpoint: its files, and how to open them in other tools.

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use spec::{Given, ValidationMetric};
use wire::{Checkpoint, Dataset, DrawnPredictions, ItemKind, Job, Report, StoredFile};

use crate::app::App;
use crate::app::checkpoints::Extents;
use crate::app::datasets::data_of;
use crate::error::ApiError;
use crate::extract::{Path, QueryPairs};
use crate::page::answer::{InPage, PageError, html};
use crate::page::follow_up;
use crate::page::labels::{Labelled, moved_aliases};
use crate::page::lineage::Lineage;
use crate::page::parts::{Commands, Fact, FileRow, Link, Snippet, pipelines};
use crate::page::predictions::{Drawn, DrawnFigure};
use crate::page::spec_text::Specification;
use crate::page::text;

#[derive(Template)]
#[template(path = "checkpoint.html")]
struct CheckpointPage {
    id: i64,
    job: i64,
    pipelines: Vec<Link>,
    /// Its name, or that of its run and its step.
    title: String,
    labelled: Labelled,
    /// Its errors in sentences: of an evaluation, or else of its validation.
    answer: String,
    run: i64,
    step: String,
    marks: String,
    aliases: Vec<String>,
    /// Sentences about aliases that stood for another checkpoint until just now.
    moved: Vec<String>,
    metrics: Vec<Fact>,
    /// Jobs that go on from it.
    follow_ups: Vec<Link>,
    architecture: String,
    digest: String,
    short_digest: String,
    /// The picture of the jobs before and after it.
    lineage: Option<Lineage>,
    files: Vec<FileRow>,
    snippets: Vec<Snippet>,
    /// A prediction of the newest evaluation that drew one, and that evaluation.
    drawn: Option<DrawnFigure>,
    evaluation: i64,
    spec: Specification,
}

pub async fn show(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
    QueryPairs(pairs): QueryPairs,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let checkpoint = app.checkpoint(id).await?;
    let job = app.job(checkpoint.job).await?;
    let extents = app.checkpoint_extents(id).await?;
    let commands = Commands::new(&headers);
    let asked = match extents {
        Some(extents) => {
            let dataset = match app.dataset_of_training(&checkpoint).await? {
                Some(dataset) => Some(app.dataset(dataset).await?),
                None => None,
            };
            Some(Asked { extents, dataset })
        }
        None => None,
    };
    let newest = app.drawn_of_checkpoint(&checkpoint).await?;
    let drawn = newest.as_ref().and_then(|(job, drawn)| Drawn::typical(job.run?, drawn));
    let evaluated = match &newest {
        Some((job, drawn)) => evaluated(&app, job, drawn, &checkpoint).await?,
        None => String::new(),
    };
    let lineage = Lineage::of(&app, &job).await?;
    let page = CheckpointPage {
        id,
        job: job.id,
        pipelines: pipelines(&job),
        title: app.name_of(ItemKind::Checkpoint, id).await?,
        answer: if evaluated.is_empty() { validated(&checkpoint) } else { evaluated },
        labelled: Labelled {
            aliases: Some(checkpoint.aliases.join(" ")),
            ..Labelled::new(
                format!("/checkpoints/{id}"),
                checkpoint.name.as_deref().unwrap_or_default(),
                checkpoint.note.as_ref(),
                &checkpoint.tags,
                &checkpoint.job_tags,
            )
        },
        moved: moved_aliases(&pairs, &checkpoint.aliases),
        aliases: checkpoint.aliases.clone(),
        run: checkpoint.run,
        step: text::count(checkpoint.step),
        marks: checkpoint.marks().join(", "),
        metrics: facts(&checkpoint),
        follow_ups: follow_up::of_checkpoint(id),
        snippets: snippets(&commands, id, &checkpoint.files, asked),
        drawn,
        evaluation: newest.map_or(0, |(job, _)| job.id),
        architecture: checkpoint.architecture,
        digest: checkpoint.digest.to_string(),
        short_digest: checkpoint.digest.short(),
        files: checkpoint.files.iter().map(FileRow::of_checkpoint).collect(),
        spec: Specification::new(&job.spec, lineage.as_ref()),
        lineage,
    };
    Ok(html(&page)?)
}

/// Its errors in an evaluation that drew it, and those of the baselines; empty without a report.
async fn evaluated(
    app: &App,
    evaluation: &Job,
    drawn: &DrawnPredictions,
    checkpoint: &Checkpoint,
) -> Result<String, ApiError> {
    let Some(run) = evaluation.run else { return Ok(String::new()) };
    let report: Option<Report> = match app.report(run).await {
        Err(error @ ApiError::Damaged { .. }) => {
            error.log();
            None
        }
        report => report?,
    };
    let predictor = drawn.predictor_of(checkpoint);
    let told = report.zip(predictor);
    Ok(told.map_or(String::new(), |(report, predictor)| {
        reports::evaluation::answer_for(&report, &predictor.name)
    }))
}

/// Its error on the validation data of its training; empty if it was not validated.
fn validated(checkpoint: &Checkpoint) -> String {
    let rmse_deg = checkpoint.metrics.get(ValidationMetric::RmseDeg.key());
    rmse_deg.map_or(String::new(), |rmse_deg| {
        let Checkpoint { architecture, .. } = checkpoint;
        format!("{architecture} has a validation RMSE of {}°.", text::degrees(*rmse_deg))
    })
}

fn facts(checkpoint: &Checkpoint) -> Vec<Fact> {
    let fact = |(key, value): (&String, &f64)| Fact::new(key, text::value(*value), String::new());
    checkpoint.metrics.iter().map(fact).collect()
}

impl FileRow {
    fn of_checkpoint(file: &StoredFile) -> Self {
        let contents = match file.name.rsplit_once('.') {
            Some((_, "safetensors")) => "tensors",
            Some((_, "json")) => "configuration",
            _ => "",
        };
        Self {
            url: file.url.clone(),
            name: file.name.clone(),
            contents: contents.to_owned(),
            size: text::size(file.size),
            sha256: file.sha256.to_string(),
        }
    }
}

/// How to use a checkpoint: in the shell and in Python, complete lines.
fn snippets(
    commands: &Commands,
    id: i64,
    files: &[StoredFile],
    asked: Option<Asked>,
) -> Vec<Snippet> {
    let model = files.iter().find(|file| file.name.starts_with("model."));
    let model = model.map_or("model.safetensors", |file| file.name.as_str());
    let pytorch = format!(
        "from safetensors.torch import load_file\n\n\
         weights = load_file(\"checkpoint-{id}/{model}\")  # name -> torch.Tensor\n\
         for name, tensor in weights.items():\n    print(name, tuple(tensor.shape))"
    );
    let mut snippets = vec![
        commands.download("checkpoint", id),
        Snippet { title: "Open it in PyTorch", text: pytorch },
    ];
    if let Some(Asked { extents, dataset }) = asked {
        let text = match dataset {
            Some(dataset) => question_of(commands, id, extents, &dataset),
            None => question_at_rest(commands, id, extents),
        };
        snippets.push(Snippet { title: "Predict", text });
    }
    snippets
}

/// The parts of the example question.
struct Asked {
    extents: Extents,
    /// The dataset that it was trained on, whose first trajectory is asked about.
    dataset: Option<Dataset>,
}

/// A command that predicts the first trajectory of a dataset.
fn question_of(commands: &Commands, id: i64, extents: Extents, dataset: &Dataset) -> String {
    let Commands { curl, origin } = commands;
    let Extents { context, horizon, joints, given } = extents;
    let data = data_of(&dataset.spec);
    let observations = data.map(|data| data.observations()).unwrap_or_default();
    let positions = if observations.measures_positions() { "q_measured" } else { "q" };
    let (known, planned) = match given {
        Given::Torques if observations.measures_torques() => ("u_measured", "u"),
        Given::Torques => ("u", "u"),
        Given::References => ("r", "r"),
    };
    let all = context + horizon;
    format!(
        "{curl} -s {origin}/v1/datasets/{dataset}/trajectories/0 | python3 -c '\n\
         import json, sys\n\
         columns = json.load(sys.stdin)[\"columns\"]\n\
         def rows(name): return list(zip(*(columns[f\"{{name}}{{joint}}\"] for joint in range(1, {beyond}))))\n\
         past = {{\"u\": rows(\"{known}\")[:{context}], \"y\": rows(\"{positions}\")[:{context}]}}\n\
         print(json.dumps({{\"scenarios\": [{{**past, \"future_u\": rows(\"{planned}\")[{context}:{all}]}}]}}))' |\n\
         {curl} --json @- {origin}/v1/checkpoints/{id}/predict",
        dataset = dataset.id,
        beyond = joints + 1,
    )
}

/// A command that predicts for an arm at rest that will be pushed.
fn question_at_rest(commands: &Commands, id: i64, extents: Extents) -> String {
    let Commands { curl, origin } = commands;
    let Extents { context, horizon, joints, .. } = extents;
    format!(
        "python3 -c 'import json; print(json.dumps({{\"scenarios\": [{{\
         \"u\": [[0] * {joints}] * {context}, \"y\": [[0] * {joints}] * {context}, \
         \"future_u\": [[1] * {joints}] * {horizon}}}]}}))' |\n\
         {curl} --json @- {origin}/v1/checkpoints/{id}/predict"
    )
}
