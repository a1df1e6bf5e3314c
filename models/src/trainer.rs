use burn::tensor::Tensor;
use spec::{JOINTS, ModelSpec, TrainSpec};

use crate::checkpoint::{self, CheckpointConfig, CheckpointFiles};
use crate::initialization::InitialWeights;
use crate::normalization::{Normalizer, Statistics, denormalize, model_input, target};
use crate::optimizer::{ModelOptimizer, NamedGradients};
use crate::parameters::host_values;
use crate::schedule::Schedule;
use crate::sequence_model::SequenceModel;
use crate::{Batch, Device, ModelError};

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
    optimizer: ModelOptimizer,
    schedule: Schedule,
    normalizer: Normalizer,
    identity: Identity,
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
}

/// One optimizer step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepReport {
    /// Steps taken, this one included.
    pub step: u64,
    /// Mean squared error of the normalized horizon before the step.
    pub loss: f64,
    /// Euclidean norm over all parameters, before clipping.
    pub gradient_norm: f64,
    pub learning_rate: f64,
}

/// How the model does on trajectories that it was not trained on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValidationReport {
    /// Mean squared error of the normalized horizon.
    pub loss: f64,
    /// √(mean over the horizon of the squared error) of each joint of each trajectory, averaged
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
        Ok(Self {
            optimizer: ModelOptimizer::new(&spec.optimizer, &model),
            model,
            schedule: Schedule::new(spec),
            normalizer,
            identity: Identity {
                model: spec.model.clone(),
                context: spec.context,
                data,
                seed: spec.seed,
                spec_digest: spec_digest.to_owned(),
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
        trainer.model = checkpoint::load_weights(trainer.model, &files.model)?;
        trainer.optimizer = checkpoint::load_optimizer(
            &spec.optimizer,
            &trainer.model,
            &files.optimizer,
            config.step,
        )?;
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
        let (loss, _, _) = self.loss(&self.model, batch, &device)?;
        let loss_value = scalar(loss.clone())?;
        finite(step, "loss", loss_value)?;

        let gradients = NamedGradients::of(&self.model, loss.backward())?;
        let gradient_norm = gradients.norm;
        finite(step, "gradient norm", gradient_norm)?;

        let learning_rate = self.schedule.learning_rate(self.step);
        self.model = self.optimizer.step(self.model.clone(), gradients, learning_rate);
        self.step = step;
        Ok(StepReport { step, loss: loss_value, gradient_norm, learning_rate })
    }

    /// Loss and error on `batch`; changes nothing.
    pub fn validate(&self, batch: &Batch) -> Result<ValidationReport, ModelError> {
        rayon::scope(|_| self.validate_in_pool(batch))
    }

    fn validate_in_pool(&self, batch: &Batch) -> Result<ValidationReport, ModelError> {
        let model = self.model.for_inference();
        let (loss, predicted, statistics) = self.loss(&model, batch, &self.device.inference())?;
        let context = self.identity.context as usize;
        let horizon = batch.samples - context;
        let mut predicted = host_values(predicted)?;
        denormalize(&mut predicted, &statistics, horizon);
        Ok(ValidationReport {
            loss: scalar(loss)?,
            rmse_rad: mean_rmse(&predicted, batch, context),
            trajectories: batch.size,
        })
    }

    /// Everything that [`Trainer::resume`] and [`crate::TrainedModel::load`] need.
    pub fn checkpoint(&self) -> Result<CheckpointFiles, ModelError> {
        let Identity { model, context, data, seed, spec_digest } = &self.identity;
        let config = CheckpointConfig::new(
            model.clone(),
            *context,
            data,
            self.normalizer,
            self.step,
            *seed,
            spec_digest,
        )?;
        checkpoint::write(&self.model, &self.optimizer, &config)
    }

    fn loss(
        &self,
        model: &SequenceModel,
        batch: &Batch,
        device: &burn::tensor::Device,
    ) -> Result<(Tensor<1>, Tensor<3>, Vec<Statistics>), ModelError> {
        let samples = self.identity.data.samples as usize;
        let context = self.identity.context as usize;
        batch.check(samples)?;
        let statistics = self.normalizer.statistics_of_batch(batch, context);
        let input = model_input(&batch.known(context), &statistics, samples, context, device);
        let predicted = model.forward(input);
        let error = predicted.clone() - target(batch, &statistics, context, device);
        Ok((error.square().mean(), predicted, statistics))
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

fn scalar(tensor: Tensor<1>) -> Result<f64, ModelError> {
    let value = tensor.inner().try_into_scalar::<f32>();
    value.map(f64::from).map_err(|error| ModelError::Device(error.to_string()))
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
