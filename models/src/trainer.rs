use std::collections::BTreeMap;

use spec::{DataSource, Digest, EmaSpec, JOINTS, ModelSpec, TrainSpec};

use crate::checkpoint::{self, CheckpointConfig, CheckpointFiles, TrainingState, Versions};
use crate::ema::WeightAverage;
use crate::frame::Framing;
use crate::initialization::InitialWeights;
use crate::normalization::{Normalizer, Statistics, model_input, target};
use crate::optimizer::{ModelOptimizer, NamedGradients};
use crate::parameters::host_values;
use crate::prediction::Predictor;
use crate::randomness::{Noise, Purpose, generator};
use crate::schedule::Schedule;
use crate::sequence_model::{Draw, Loss, SequenceModel};
use crate::{Batch, Device, FORMAT_VERSION, ModelError, Sampling};

/// The metric that every checkpoint after a step has.
const TRAIN_LOSS: &str = "train/loss";

/// What a trainer must know of its dataset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingData {
    /// Samples of every trajectory, context and horizon.
    pub samples: u32,
    pub rate_hz: f64,
    /// Of the trajectories trained on; needed for [`spec::Normalization::Dataset`] only.
    pub statistics: Option<Statistics>,
}

/// Trains one model. Does no validation, logging or saving unless asked.
pub struct Trainer {
    model: SequenceModel,
    /// Of the weights, which is then what is validated and kept.
    average: Option<WeightAverage>,
    optimizer: ModelOptimizer,
    schedule: Schedule,
    normalizer: Normalizer,
    framing: Framing,
    identity: Identity,
    /// Parts that a batch is computed in.
    parts: usize,
    metrics: BTreeMap<String, f64>,
    device: Device,
    /// Steps taken.
    step: u64,
}

/// What a checkpoint must agree in with the training that resumes from it.
struct Identity {
    model: ModelSpec,
    context: u32,
    data: TrainingData,
    seed: u64,
    spec_digest: String,
    dataset_digest: Option<String>,
    ema: Option<EmaSpec>,
}

/// One optimizer step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepReport {
    /// Steps taken, this one included.
    pub step: u64,
    /// What the architecture makes small, before the step: of one that predicts positions their
    /// mean squared error, normalized; of a gaussian head the negative logarithm of the likelihood;
    /// of a denoiser the weighted mean squared error of what it predicts of the noise.
    pub loss: f64,
    /// Euclidean norm over all parameters, before clipping.
    pub gradient_norm: f64,
    pub learning_rate: f64,
}

/// How the model does on trajectories that it was not trained on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValidationReport {
    /// As [`StepReport::loss`]; with the same noise at every validation.
    pub loss: f64,
    /// Of [`crate::TrainedModel::predict`]: √(mean over the horizon of the squared error) of each joint of each trajectory, averaged
    /// over both; rad.
    pub rmse_rad: f64,
    /// Trajectories, the weight of this report in a mean over several.
    pub trajectories: usize,
}

impl Trainer {
    /// A model with initial weights from the spec's seed. `spec_digest` is written into every
    /// checkpoint and asked for by [`Trainer::resume`].
    ///
    /// # Errors
    /// [`ModelError::Size`] for sizes that do not fit each other,
    /// [`ModelError::MissingStatistics`].
    pub fn new(
        spec: &TrainSpec,
        data: TrainingData,
        spec_digest: &str,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let normalizer = Normalizer::new(spec.normalization, data.statistics)?;
        let training = device.training();
        let mut weights = InitialWeights::new(spec.seed, &training);
        let horizon = horizon(spec.context, data.samples)?;
        let model = SequenceModel::new(&spec.model, spec.context, horizon, &mut weights)?;
        let dataset_digest = match &spec.data {
            DataSource::Digest(digest) => Some(digest.to_string()),
            DataSource::Stream(_) => {
                let value = serde_json::to_value(&spec.data).unwrap_or_default();
                Some(Digest::of_json(&value).to_string())
            }
            DataSource::Job(_) | DataSource::Dataset(_) => None,
        };
        Ok(Self {
            optimizer: ModelOptimizer::new(&spec.optimizer, &model),
            average: spec.ema.map(|ema| WeightAverage::new(ema, &model)),
            model,
            schedule: Schedule::new(spec),
            normalizer,
            framing: Framing {
                residual: spec.model.residual(),
                samples: data.samples as usize,
                context: spec.context as usize,
                rate_hz: data.rate_hz,
            },
            parts: spec.gradient_accumulation.max(1) as usize,
            metrics: BTreeMap::new(),
            identity: Identity {
                model: spec.model.clone(),
                context: spec.context,
                data,
                seed: spec.seed,
                spec_digest: spec_digest.to_owned(),
                dataset_digest,
                ema: spec.ema,
            },
            device: device.clone(),
            step: 0,
        })
    }

    /// The trainer that wrote `files`: goes on as if it had never stopped, bit for bit. The
    /// dataset's statistics are the checkpoint's.
    ///
    /// # Errors
    /// Damaged files, and [`ModelError::OtherTraining`] when they are another training's.
    pub fn resume(
        spec: &TrainSpec,
        data: TrainingData,
        spec_digest: &str,
        files: &CheckpointFiles,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let config = CheckpointConfig::parse(&files.config)?;
        agree("spec", config.spec_digest.as_str(), spec_digest)?;
        agree("samples", &config.samples, &data.samples)?;
        agree("context", &config.context, &spec.context)?;
        if config.ema != spec.ema {
            let (found, expected) = (format!("{:?}", config.ema), format!("{:?}", spec.ema));
            return Err(ModelError::OtherTraining { field: "ema", found, expected });
        }
        if config.model != spec.model {
            let (found, expected) = (format!("{:?}", config.model), format!("{:?}", spec.model));
            return Err(ModelError::OtherTraining { field: "model", found, expected });
        }
        let statistics = match config.normalizer {
            Normalizer::Dataset(statistics) => Some(statistics),
            Normalizer::Context | Normalizer::PaperLeaky => None,
        };
        let mut trainer =
            Self::new(spec, TrainingData { statistics, ..data }, spec_digest, device)?;
        let kept = checkpoint::load_weights(trainer.model, &files.model)?;
        let mut state = TrainingState::read(&files.optimizer)?;
        trainer.average = spec.ema.map(|ema| WeightAverage::new(ema, &kept));
        trainer.model = if spec.ema.is_some() { state.weights(kept)? } else { kept };
        trainer.optimizer = state.optimizer(&spec.optimizer, &trainer.model, config.step)?;
        trainer.metrics = config.metrics;
        trainer.step = config.step;
        Ok(trainer)
    }

    /// Steps taken.
    pub fn steps_done(&self) -> u64 {
        self.step
    }

    /// One optimizer step on `batch`.
    ///
    /// # Errors
    /// A batch of the wrong shape or with values that are not finite; [`ModelError::NotFinite`]
    /// when loss or gradient are not, after which the trainer is as it was before.
    pub fn step(&mut self, batch: &Batch) -> Result<StepReport, ModelError> {
        // On a thread of the pool: from any other, each of the hundreds of parallel loops of a step
        // would wake a worker and wait for it.
        rayon::scope(|_| self.step_in_pool(batch))
    }

    fn step_in_pool(&mut self, batch: &Batch) -> Result<StepReport, ModelError> {
        let step = self.step + 1;
        let device = self.device.training();
        batch.check(self.framing.samples)?;
        let mut gradients = Vec::with_capacity(self.parts);
        let mut loss_value = 0.0;
        let part_size = batch.size.div_ceil(self.parts);
        for first in (0..batch.size).step_by(part_size) {
            let part = batch.part(first, part_size);
            let share = part.size as f64 / batch.size as f64;
            let mut noise = self.noise(Purpose::Training, step, first, part.size);
            let loss = self.loss(&self.model, &part, &mut noise, &device)?;
            loss_value += share * loss.value()?;
            finite(step, "loss", loss_value)?;
            let tensor = loss.tensor();
            let tensor = if self.parts == 1 { tensor } else { tensor * share };
            gradients.push(tensor.backward());
        }

        let gradients = NamedGradients::of(&self.model, gradients)?;
        let gradient_norm = gradients.norm;
        finite(step, "gradient norm", gradient_norm)?;

        let learning_rate = self.schedule.learning_rate(self.step);
        self.model = self.optimizer.step(self.model.clone(), gradients, learning_rate);
        if let Some(average) = &mut self.average {
            average.update(&self.model, step);
        }
        self.step = step;
        self.note(TRAIN_LOSS, loss_value);
        Ok(StepReport { step, loss: loss_value, gradient_norm, learning_rate })
    }

    /// Writes `value` into the checkpoints from here on, in place of an older one.
    pub fn note(&mut self, metric: &str, value: f64) {
        // JSON has no others.
        if value.is_finite() {
            self.metrics.insert(metric.to_owned(), value);
        }
    }

    /// Loss and error on `batch`, of the averaged weights where there are any; changes nothing.
    pub fn validate(&self, batch: &Batch) -> Result<ValidationReport, ModelError> {
        rayon::scope(|_| self.validate_in_pool(batch))
    }

    fn validate_in_pool(&self, batch: &Batch) -> Result<ValidationReport, ModelError> {
        let model = self.kept_model();
        let device = self.device.inference();
        let context = self.framing.context;
        let mut noise = self.noise(Purpose::Validation, 0, 0, batch.size);
        let loss = self.loss(&model, batch, &mut noise, &device)?;
        let known = batch.known(context);
        let statistics = self.normalizer.statistics_of_batch(batch, context);
        let predicted = match &loss.predicted {
            Some(predicted) => {
                let mut predicted = host_values(predicted.clone())?;
                let frames = self.framing.frames(&known, &statistics);
                let rows = predicted.chunks_exact_mut((batch.samples - context) * JOINTS);
                for (y, frame) in rows.zip(&frames) {
                    frame.restore(y, context);
                }
                predicted
            }
            None => {
                let (spec, framing) = (&self.identity.model, self.framing);
                let predictor = Predictor { model: &model, spec, framing, device };
                predictor.answer(&known, &statistics, &Sampling::default(), Draw::Mean)?
            }
        };
        Ok(ValidationReport {
            loss: loss.value()?,
            rmse_rad: mean_rmse(&predicted, batch, context),
            trajectories: batch.size,
        })
    }

    /// What predicts.
    fn kept_model(&self) -> SequenceModel {
        match &self.average {
            Some(average) => average.model(&self.model),
            None => self.model.for_inference(),
        }
    }

    /// Everything that [`Trainer::resume`] and [`crate::TrainedModel::load`] need.
    pub fn checkpoint(&self) -> Result<CheckpointFiles, ModelError> {
        let Identity { model, context, data, seed, spec_digest, dataset_digest, ema } =
            &self.identity;
        let horizon = horizon(*context, data.samples)?;
        let config = CheckpointConfig {
            format_version: FORMAT_VERSION,
            parameters: SequenceModel::parameter_count(model, *context, horizon)?,
            model: model.clone(),
            context: *context,
            horizon,
            samples: data.samples,
            rate_hz: data.rate_hz,
            normalizer: self.normalizer,
            step: self.step,
            seed: *seed,
            spec_digest: spec_digest.clone(),
            dataset_digest: dataset_digest.clone(),
            ema: *ema,
            metrics: self.metrics.clone(),
            versions: Versions::current(),
        };
        let average = self.average.as_ref().map(|average| average.model(&self.model));
        checkpoint::write(&self.model, average.as_ref(), &self.optimizer, &config)
    }

    /// For trajectories `first..first + size` of a batch.
    fn noise(&self, purpose: Purpose, step: u64, first: usize, size: usize) -> Noise {
        let seed = self.identity.seed;
        let rows = first..first + size;
        Noise::new(rows.map(|trajectory| generator(seed, purpose, step, trajectory as u64)))
    }

    fn loss(
        &self,
        model: &SequenceModel,
        batch: &Batch,
        noise: &mut Noise,
        device: &burn::tensor::Device,
    ) -> Result<Loss, ModelError> {
        batch.check(self.framing.samples)?;
        let context = self.framing.context;
        let statistics = self.normalizer.statistics_of_batch(batch, context);
        let known = batch.known(context);
        let frames = self.framing.frames(&known, &statistics);
        let input = model_input(&known, &statistics, &frames, device);
        Ok(model.loss(input, target(batch, &frames, context, device), noise))
    }
}

/// Samples after the context.
pub(crate) fn horizon(context: u32, samples: u32) -> Result<u32, ModelError> {
    match samples.checked_sub(context) {
        Some(horizon) if horizon > 0 && context > 0 => Ok(horizon),
        _ => Err(ModelError::Size {
            field: "context",
            value: context.into(),
            allowed: format!("1 to {}, one less than the samples", samples.saturating_sub(1)),
        }),
    }
}

fn finite(step: u64, quantity: &'static str, value: f64) -> Result<(), ModelError> {
    if value.is_finite() { Ok(()) } else { Err(ModelError::NotFinite { step, quantity, value }) }
}

fn agree<T: PartialEq + ToString + ?Sized>(
    field: &'static str,
    found: &T,
    expected: &T,
) -> Result<(), ModelError> {
    if found == expected {
        return Ok(());
    }
    let (found, expected) = (found.to_string(), expected.to_string());
    Err(ModelError::OtherTraining { field, found, expected })
}

/// `predicted` is `[size, horizon, 7]` in rad.
fn mean_rmse(predicted: &[f32], batch: &Batch, context: usize) -> f64 {
    let horizon = batch.samples - context;
    let mut total = 0.0;
    let truths = batch.y.chunks_exact(batch.samples * JOINTS);
    for (predicted, truth) in predicted.chunks_exact(horizon * JOINTS).zip(truths) {
        let mut squares = [0.0; JOINTS];
        let truth = truth[context * JOINTS..].chunks_exact(JOINTS);
        for (predicted, truth) in predicted.chunks_exact(JOINTS).zip(truth) {
            for joint in 0..JOINTS {
                squares[joint] += f64::from(predicted[joint] - truth[joint]).powi(2);
            }
        }
        total += squares.map(|sum: f64| (sum / horizon as f64).sqrt()).iter().sum::<f64>();
    }
    total / (batch.size.max(1) * JOINTS) as f64
}
