//! Checkpoints predict a stored trajectory, at once and without a job.

use series::{MeasurementNoise, Shape};
use spec::{Column, Given, Lengths, SamplerSpec};
use store::RunId;
use wire::{PredictionSampling, TrajectoryPrediction, TrajectoryPredictions};

use crate::app::App;
use crate::app::labels::is_alias;
use crate::app::predictions::{HeldModel, milliseconds};
use crate::app::questions::{RequestViolations, asked, numbers_of, series_of};
use crate::app::remembered::PredictionKey;
use crate::app::trajectories::StoredTrajectory;
use crate::error::ApiError;
use crate::limits::{PREDICTED_CHECKPOINTS, SHOWN_SAMPLES};
use crate::live::{AboutModel, LiveQueue, Question};

/// Samples of a model that gives several answers, by default.
const SAMPLES: u32 = 16;

/// Ends of the shown interval.
const QUANTILES: [f64; 2] = [0.05, 0.95];

/// The name of the baseline beside the checkpoints.
const HELD: &str = "hold-last";

/// Which predictions of a trajectory are wanted.
#[derive(Clone, Debug, Default)]
pub struct PredictionsRequest {
    /// Ids of checkpoints, each once.
    pub checkpoints: Vec<i64>,
    /// The sample at which the horizon begins. Default: the end of the longest context.
    pub begin: Option<usize>,
    /// Samples per checkpoint that gives several answers; 1 is a single answer.
    pub samples: Option<u32>,
    /// Steps of the samplers of models that remove noise. Default: as trained.
    pub steps: Option<u32>,
    /// The seed of all samples.
    pub seed: u64,
}

impl PredictionsRequest {
    /// Reads the fields of a query, and ignores others. Gives the request without its checkpoints, and the ids and aliases
    /// of these, each once. `checkpoint` has them separated by commas, and may come several times.
    ///
    /// # Errors
    /// [`ApiError::Parameter`] for the first invalid field.
    fn read(pairs: &[(String, String)]) -> Result<(Self, Vec<&str>), ApiError> {
        let (mut request, mut names) = (Self::default(), Vec::new());
        for (name, value) in pairs {
            match name.as_str() {
                "checkpoint" => {
                    for named in value.split(',').map(str::trim) {
                        if !names.contains(&named) {
                            names.push(named);
                        }
                    }
                }
                "begin" => request.begin = Some(number(name, value, "a sample, from 0")?),
                "samples" => request.samples = Some(number(name, value, "a whole number, from 1")?),
                "steps" => request.steps = Some(number(name, value, "a whole number, from 1")?),
                "seed" => request.seed = number(name, value, "a whole number, from 0")?,
                _ => {}
            }
        }
        if names.len() > PREDICTED_CHECKPOINTS {
            let allowed = format!("at most {PREDICTED_CHECKPOINTS} checkpoints");
            return Err(ApiError::parameter("checkpoint", names.len(), allowed));
        }
        Ok((request, names))
    }

    /// How a model is asked.
    fn sampling(&self, about: &AboutModel) -> PredictionSampling {
        let samples = self.samples.unwrap_or(SAMPLES);
        let has_samples = about.has_samples && samples != 1;
        let sampler = about.sampler.filter(|_| self.steps.is_some());
        PredictionSampling {
            sampler: sampler.map(|sampler| SamplerSpec { steps: self.steps, ..sampler }),
            samples: has_samples.then_some(samples),
            quantiles: if has_samples { QUANTILES.to_vec() } else { Vec::new() },
            return_samples: has_samples,
            seed: self.seed,
        }
    }
}

fn number<T: std::str::FromStr>(name: &str, value: &str, allowed: &str) -> Result<T, ApiError> {
    value.trim().parse().map_err(|_| ApiError::parameter(name, value, allowed))
}

impl App {
    /// Reads the fields of a query, and finds the checkpoints that aliases stand for.
    ///
    /// # Errors
    /// [`ApiError::Parameter`] for the first invalid field, and when no checkpoint has an alias.
    pub(crate) async fn predictions_request(
        &self,
        pairs: &[(String, String)],
    ) -> Result<PredictionsRequest, ApiError> {
        let (mut request, names) = PredictionsRequest::read(pairs)?;
        for name in names {
            let id = match is_alias(name) {
                true => self.checkpoint_of_alias(name).await?,
                false => number("checkpoint", name, "ids or aliases of checkpoints")?,
            };
            if !request.checkpoints.contains(&id) {
                request.checkpoints.push(id);
            }
        }
        Ok(request)
    }

    /// The predictions of checkpoints for a stored trajectory, and that of the last position.
    ///
    /// # Errors
    /// When the trajectory or a checkpoint does not exist or cannot be read, when a model cannot be
    /// used, and [`ApiError::Question`] where it does not fit the trajectory or the request.
    pub(crate) async fn predict_trajectory(
        &self,
        dataset: i64,
        trajectory: u64,
        request: &PredictionsRequest,
    ) -> Result<TrajectoryPredictions, ApiError> {
        let stored = self.trajectory(dataset, trajectory).await?;
        let mut models = Vec::with_capacity(request.checkpoints.len());
        for &checkpoint in &request.checkpoints {
            let held = self.held_model(checkpoint).await?;
            // A window refuses a model that does not answer at the trajectory's rate.
            models.push(held.at(Some(stored.rate_hz)).unwrap_or(held));
        }
        let window = Window::of(&stored, &models, request.begin)?;
        let truth = stored.rows(Column::positions(stored.joints()))?;
        let mut predictions = Vec::with_capacity(models.len() + 1);
        for held in &models {
            let answered = self.answered(&stored, &truth[window.begin..], held, request).await?;
            predictions.push(TrajectoryPrediction {
                name: self.name_of_checkpoint(held.resource.checkpoint).await?,
                checkpoint: Some(held.resource.checkpoint),
                ..answered
            });
        }
        let last = stored.measured(Given::Torques)?.y.swap_remove(window.begin - 1);
        let held = TrajectoryPrediction {
            name: HELD.to_owned(),
            y: vec![last; window.horizon],
            ..TrajectoryPrediction::default()
        };
        predictions.push(held.against(&truth[window.begin..window.begin + window.horizon]));
        Ok(TrajectoryPredictions {
            dataset,
            trajectory,
            rate_hz: stored.rate_hz,
            samples: truth.len(),
            begin: window.begin,
            first: window.first(),
            truth: truth[window.first()..window.begin + window.horizon].to_vec(),
            predictions,
        })
    }

    /// The prediction of a checkpoint, without its name, where the true positions from the horizon's first sample on are
    /// `future`. A prediction that is remembered is not computed again.
    async fn answered(
        &self,
        stored: &StoredTrajectory,
        future: &[Vec<f32>],
        HeldModel { resource, model, about }: &HeldModel,
        request: &PredictionsRequest,
    ) -> Result<TrajectoryPrediction, ApiError> {
        let begin = stored.samples() - future.len();
        let key = resource.weights.map(|weights| PredictionKey {
            dataset: stored.digest,
            trajectory: stored.index,
            weights,
            begin,
            samples: request.samples,
            steps: request.steps,
            seed: request.seed,
        });
        if let Some(remembered) = key.and_then(|key| self.remembered.get(&key)) {
            return Ok(remembered);
        }
        let sampling = request.sampling(about);
        let mut violations = RequestViolations::default();
        violations.sampling(&sampling, 1, about);
        violations.finish()?;
        let _memory = self.checks.memory(numbers_of(1, about) * size_of::<f32>())?;
        let question = question(stored, about, begin, &sampling)?;
        let prediction = model.predict(question, LiveQueue::Requests).await?;
        let own_steps = about.sampler.and_then(|sampler| sampler.steps);
        let steps = sampling.sampler.map_or(own_steps, |sampler| sampler.steps);
        let horizon = about.horizon;
        // The quantiles of many samples take long.
        let answer = self.checks.run(prediction.answered_bytes(&sampling), move || {
            Ok((prediction.of(0, 1, horizon, &sampling), prediction))
        });
        let (mut answer, prediction) = answer.await?;
        let mut samples = answer.samples.take().unwrap_or_default();
        samples.truncate(SHOWN_SAMPLES);
        let found = TrajectoryPrediction {
            y: answer.y,
            quantiles: answer.quantiles,
            samples,
            steps,
            compute_ms: Some(milliseconds(prediction.computed)),
            warnings: prediction.warnings,
            ..TrajectoryPrediction::default()
        };
        let found = found.against(&future[..horizon]);
        if let Some(key) = key {
            self.remembered.insert(key, found.clone());
        }
        Ok(found)
    }

    /// The names that an evaluation of the same predictors gives them, in their order. Figures choose
    /// colours by these.
    pub(crate) async fn names_in_evaluations(
        &self,
        predictions: &TrajectoryPredictions,
    ) -> Result<Vec<String>, ApiError> {
        let mut predictors = Vec::new();
        for prediction in &predictions.predictions {
            predictors.push(match prediction.checkpoint {
                None => Predictor::Baseline(prediction.name.clone()),
                Some(id) => {
                    let checkpoint = self.checkpoint(id).await?;
                    let run = self.store.run(RunId(checkpoint.run)).await?;
                    Predictor::Checkpoint {
                        id,
                        architecture: checkpoint.architecture,
                        own_name: checkpoint.name.unwrap_or(run.name),
                    }
                }
            });
        }
        Ok(names_of(&predictors))
    }

    /// The name that users gave a checkpoint, or its architecture and its id.
    async fn name_of_checkpoint(&self, id: i64) -> Result<String, ApiError> {
        let checkpoint = self.checkpoint(id).await?;
        Ok(checkpoint.name.unwrap_or_else(|| format!("{} {id}", checkpoint.architecture)))
    }
}

/// The names that a predictor may have.
enum Predictor {
    Baseline(String),
    Checkpoint { id: i64, architecture: String, own_name: String },
}

/// Checkpoints of the same architecture have their own names, as in evaluations
/// (`worker/src/evaluate/checkpoints.rs`), and their ids where those are equal too.
fn names_of(predictors: &[Predictor]) -> Vec<String> {
    let shared = |of: &dyn Fn(&Predictor) -> bool| {
        predictors.iter().filter(|predictor| of(predictor)).count() > 1
    };
    let name = |predictor: &Predictor| match predictor {
        Predictor::Baseline(name) => name.clone(),
        Predictor::Checkpoint { id, architecture, own_name } => {
            let has_architecture = |other: &Predictor| matches!(other, Predictor::Checkpoint { architecture: it, .. } if it == architecture);
            let has_own_name = |other: &Predictor| matches!(other, Predictor::Checkpoint { own_name: it, .. } if it == own_name);
            match (shared(&has_architecture), shared(&has_own_name)) {
                (false, _) => architecture.clone(),
                (true, false) => own_name.clone(),
                (true, true) => format!("{own_name} {id}"),
            }
        }
    };
    predictors.iter().map(name).collect()
}

/// The samples of a trajectory that are shown.
struct Window {
    /// The first sample of the horizon.
    begin: usize,
    /// The longest context and horizon.
    context: usize,
    horizon: usize,
}

impl Window {
    /// Checks that every model can answer.
    fn of(
        stored: &StoredTrajectory,
        models: &[HeldModel],
        begin: Option<usize>,
    ) -> Result<Self, ApiError> {
        let samples = stored.samples();
        let mut violations = RequestViolations::default();
        let abouts = || models.iter().map(|held| &held.about);
        for HeldModel { resource, about, .. } in models {
            let field = format!("checkpoint {}", resource.checkpoint);
            if about.joints != stored.joints() {
                let allowed = format!("{} joints, as the trajectory has", stored.joints());
                violations.add(&field, format!("{} joints", about.joints), allowed);
            }
            if (about.rate_hz - stored.rate_hz).abs() > 1e-9 * stored.rate_hz {
                let part = match about.lengths {
                    Lengths::Any => ", or a whole part of it",
                    _ => "",
                };
                let allowed = format!("{} Hz, as the trajectory has{part}", stored.rate_hz);
                violations.add(&field, format!("{} Hz", about.rate_hz), allowed);
            }
            if about.context + about.horizon > samples {
                let found = format!("context {} and horizon {}", about.context, about.horizon);
                let allowed = format!("at most {samples} samples together, as the trajectory has");
                violations.add(&field, found, allowed);
            }
            if about.given == Given::References && !stored.data.has_references() {
                let allowed =
                    "trained with given torques, because the trajectory has no references";
                violations.add(&field, "trained with given references", allowed);
            }
        }
        violations.finish()?;
        // Without a model, half of the trajectory is known.
        let context = abouts().map(|about| about.context).max().unwrap_or(samples / 2).max(1);
        let horizon = abouts().map(|about| about.horizon).max();
        let horizon = horizon.unwrap_or(samples.saturating_sub(context));
        let begin = begin.unwrap_or(context);
        let latest = samples.saturating_sub(horizon);
        if !(context..=latest).contains(&begin) {
            let mut violations = RequestViolations::default();
            let allowed = if context > latest {
                format!(
                    "no sample: the longest context has {context} samples, the longest horizon {horizon}, the trajectory \
                     {samples}"
                )
            } else {
                format!(
                    "{context} to {latest}: the longest context before it, and the longest horizon after it"
                )
            };
            violations.add("begin", begin, allowed);
            violations.finish()?;
        }
        Ok(Self { begin, context, horizon })
    }

    /// As many samples of the context are shown as of the horizon.
    fn first(&self) -> usize {
        self.begin - self.context.min(self.horizon)
    }
}

/// The question of a model about the motion after sample `begin`.
fn question(
    stored: &StoredTrajectory,
    about: &AboutModel,
    begin: usize,
    sampling: &PredictionSampling,
) -> Result<Question, ApiError> {
    let AboutModel { context, horizon, joints, rate_hz, given, .. } = *about;
    let Measured { u, y } = stored.measured(given)?;
    // Planned torques and references have no noise.
    let planned = stored.rows(stored.inputs(given))?;
    let known = begin - context..begin;
    let future = &planned[begin..begin + horizon];
    let u = u[known.clone()].iter().chain(future).flatten().copied().collect();
    let y = y[known].iter().flatten().copied().collect();
    let shape = Shape { robots: 1, samples: context + horizon, joints };
    let series = series_of(shape, context, rate_hz, u, y)?;
    let noise =
        MeasurementNoise::new(stored.data.position_deviation_rad(), stored.data.torque_noise_nm());
    Ok(asked(sampling, series.with_noise(noise)))
}

/// The measured values: a row of inputs and one of positions per sample.
struct Measured {
    u: Vec<Vec<f32>>,
    y: Vec<Vec<f32>>,
}

impl StoredTrajectory {
    pub fn joints(&self) -> usize {
        self.data.joints()
    }

    /// The columns of what a model is given beside positions.
    fn inputs(&self, given: Given) -> Box<dyn Iterator<Item = Column>> {
        match given {
            Given::Torques => Box::new(Column::torques(self.joints())),
            Given::References => Box::new(Column::references(self.joints())),
        }
    }

    fn measured(&self, given: Given) -> Result<Measured, ApiError> {
        let (joints, observations) = (self.joints(), self.data.observations());
        let u = match given {
            Given::Torques if observations.measures_torques() => {
                self.rows(Column::measured_torques(joints))?
            }
            _ => self.rows(self.inputs(given))?,
        };
        let y = match observations.measures_positions() {
            true => self.rows(Column::measured_positions(joints))?,
            false => self.rows(Column::positions(joints))?,
        };
        Ok(Measured { u, y })
    }

    /// A row per sample of these columns.
    fn rows(&self, columns: impl Iterator<Item = Column>) -> Result<Vec<Vec<f32>>, ApiError> {
        let values: Option<Vec<&[f32]>> =
            columns.map(|column| self.channel(&column.name)).collect();
        let values = values.ok_or_else(|| ApiError::ShardUnreadable {
            dataset: self.dataset,
            shard: self.shard,
            reason: "a column of its torques or positions is missing".to_owned(),
        })?;
        let row = |sample: usize| values.iter().map(|column| column[sample]).collect();
        Ok((0..self.samples()).map(row).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn predictors_are_called_as_in_an_evaluation_of_them() {
        let checkpoint = |id: i64, architecture: &str, own_name: &str| Predictor::Checkpoint {
            id,
            architecture: architecture.to_owned(),
            own_name: own_name.to_owned(),
        };
        let held = || Predictor::Baseline("hold-last".to_owned());
        let alone = [checkpoint(3, "robomorph", "wide"), held()];
        assert_eq!(names_of(&alone), ["robomorph", "hold-last"]);
        let several = [
            checkpoint(3, "robomorph", "wide"),
            checkpoint(4, "robomorph", "deep"),
            checkpoint(5, "cdt", "wide"),
        ];
        assert_eq!(names_of(&several), ["wide 3", "deep", "cdt"]);
        let of_a_run = [checkpoint(3, "robomorph", "wide"), checkpoint(4, "robomorph", "wide")];
        assert_eq!(names_of(&of_a_run), ["wide 3", "wide 4"]);
    }
}
