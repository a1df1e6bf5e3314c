//! Training: one step of the optimizer for each batch.

use std::collections::BTreeMap;

use kernels::Interrupt;
use random::ChaCha12Rng;
use series::{Series, SeriesView};
use spec::{DataSource, DataSources, Digest, EmaSpec, Given, Lengths, ModelSpec, Range, TrainSpec};

use crate::architecture::{Draw, Extents, ModelInput};
use crate::checkpoint::{
    self, CheckpointConfig, CheckpointFiles, InitialCheckpoint, Origin, TrainingState, Versions,
};
use crate::device::host_values;
use crate::ema::WeightAverage;
use crate::frame::{Frame, Framing};
use crate::frozen::freeze;
use crate::gradient_sum::{self, GradientSum};
use crate::initialization::InitialWeights;
use crate::loss::Loss;
use crate::memory::{parameter_count, parameters_of};
use crate::micro_batches::MicroBatching;
use crate::normalization::{Normalizer, Statistics, model_input, target};
use crate::optimizer::{ModelOptimizer, NamedGradients, Schedule};
use crate::prediction::Predictor;
use crate::randomness::{Noise, Purpose, generator};
use crate::ranges::DataRanges;
use crate::sequence_model::SequenceModel;
use crate::shapes::check_batch;
use crate::validation::{ValidationPart, ValidationReport};
use crate::{Device, FORMAT_VERSION, ModelError, Sampling};

/// The metric that every checkpoint has after the first step.
const TRAIN_LOSS: &str = "train/loss";

/// The description of a dataset that a trainer needs.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingData {
    /// Samples of every trajectory, context and horizon.
    pub samples: u32,
    /// Joints of the arm.
    pub joints: usize,
    /// Samples per second.
    pub rate_hz: f64,
    /// Statistics of the training trajectories. Only [`spec::Normalization::Dataset`] needs them.
    pub statistics: Option<Statistics>,
}

/// Trains one model. The caller asks for validation and checkpoints.
pub struct Trainer {
    model: SequenceModel,
    /// The average of the weights. If there is one, it is validated and saved.
    average: Option<WeightAverage>,
    optimizer: ModelOptimizer,
    schedule: Schedule,
    normalizer: Normalizer,
    /// Joints of the arm.
    joints: usize,
    framing: Framing,
    identity: Identity,
    /// The division of a batch.
    micro_batching: MicroBatching,
    /// The weight of each joint's errors in the loss.
    loss_weights: Option<Vec<f64>>,
    interrupt: Interrupt,
    metrics: BTreeMap<String, f64>,
    /// Ranges of all batches so far. `None` before the first batch, and after a checkpoint without
    /// ranges.
    ranges: Option<DataRanges>,
    /// Position limits of each joint, rad, for predictions with the checkpoint.
    limits_rad: Vec<Range>,
    device: Device,
    /// Steps taken.
    step: u64,
}

/// The properties that a checkpoint and a training that resumes from it must share.
struct Identity {
    model: ModelSpec,
    context: u32,
    data: TrainingData,
    seed: u64,
    spec_digest: String,
    dataset_digest: Option<String>,
    ema: Option<EmaSpec>,
    given: Given,
    /// The checkpoint that a fine-tuning began from.
    init: Option<Origin>,
}

/// One optimizer step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepReport {
    /// Steps taken, this one included.
    pub step: u64,
    /// The loss before the step. A model that predicts positions has their mean squared error,
    /// normalized. A gaussian head has the negative log-likelihood. A denoiser has the weighted
    /// mean squared error of its prediction of the noise, and a flow the mean squared error of its
    /// prediction. Equations of motion have the negative log-likelihood of a torque, up to a
    /// constant. A Transformer relative to a path has the mean over joints of the root mean square
    /// error, in degrees.
    pub loss: f64,
    /// Euclidean norm over all parameters, before clipping.
    pub gradient_norm: f64,
    /// The learning rate of the step.
    pub learning_rate: f64,
}

impl Trainer {
    /// A trainer of a model with initial weights from the spec's seed. Every checkpoint contains
    /// `spec_digest`, and [`Trainer::resume`] checks it.
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
        let normalizer = Normalizer::new(spec.normalization, data.statistics.clone())?;
        if let Some(weights) = &spec.loss_weights
            && weights.len() != data.joints
        {
            let (actual, expected) = (weights.len(), data.joints);
            return Err(ModelError::Length { what: "loss_weights", actual, expected });
        }
        let training = device.training();
        let mut weights = InitialWeights::new(spec.seed, &training);
        let extents = Extents::new(spec.context, data.samples, data.joints)?;
        let model = SequenceModel::new(&spec.model, extents, &mut weights)?;
        let parameters = parameters_of(&model);
        let micro_batching =
            MicroBatching::new(spec, spec.gradient_accumulation, parameters, device.kind());
        Ok(Self {
            optimizer: ModelOptimizer::new(&spec.optimizer, &model),
            average: spec.ema.map(|ema| WeightAverage::new(ema, &model)),
            model,
            schedule: Schedule::new(spec),
            normalizer,
            joints: data.joints,
            framing: Framing {
                residual: spec.model.residual(),
                samples: data.samples as usize,
                context: spec.context as usize,
                rate_hz: data.rate_hz,
            },
            micro_batching,
            loss_weights: spec.loss_weights.clone(),
            interrupt: Interrupt::default(),
            metrics: BTreeMap::new(),
            ranges: None,
            limits_rad: Vec::new(),
            identity: Identity {
                model: spec.model.clone(),
                context: spec.context,
                data,
                seed: spec.seed,
                spec_digest: spec_digest.to_owned(),
                dataset_digest: digest_of(&spec.data),
                ema: spec.ema,
                given: spec.given,
                init: None,
            },
            device: device.clone(),
            step: 0,
        })
    }

    /// A trainer whose weights are those of another training's checkpoint, the averaged ones where
    /// there are any. Its steps and its optimizer begin anew. The spec's frozen parameters keep
    /// these weights. Fixed statistics are those of the checkpoint, because its weights belong to
    /// them; the ranges of its data are extended.
    ///
    /// # Errors
    /// Those of [`Trainer::new`]. [`ModelError::OtherTraining`] when the checkpoint's model, arm,
    /// rate or normalization is another one, [`ModelError::CheckpointFile`] when it is damaged or
    /// its tensors have other shapes.
    pub fn fine_tune(
        spec: &TrainSpec,
        mut data: TrainingData,
        spec_digest: &str,
        init: &InitialCheckpoint,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let config = CheckpointConfig::parse(&init.config)?;
        agree("architecture", config.model.architecture(), spec.model.architecture())?;
        agree("joints", &config.joints, &data.joints)?;
        agree("rate_hz", &config.rate_hz, &data.rate_hz)?;
        agree("given", &config.given, &spec.given)?;
        data.statistics = config.normalizer.statistics();
        let mut trainer = Self::new(spec, data, spec_digest, device)?;
        if trainer.normalizer != config.normalizer {
            let (found, expected) = (config.normalizer.name(), trainer.normalizer.name());
            return Err(ModelError::OtherTraining {
                field: "normalization",
                found: found.to_owned(),
                expected: expected.to_owned(),
            });
        }
        let model = checkpoint::load_weights(trainer.model, &init.model)?;
        trainer.model = freeze(model, &spec.frozen)?;
        trainer.average = spec.ema.map(|ema| WeightAverage::new(ema, &trainer.model));
        trainer.ranges = config.ranges;
        trainer.identity.init = Some(Origin { spec_digest: config.spec_digest, step: config.step });
        Ok(trainer)
    }

    /// Restores the trainer that wrote `files`. It continues as if it had never stopped, bit for
    /// bit. The dataset's statistics come from the checkpoint.
    ///
    /// # Errors
    /// The files are damaged, or belong to another training: [`ModelError::OtherTraining`].
    pub fn resume(
        spec: &TrainSpec,
        mut data: TrainingData,
        spec_digest: &str,
        files: &CheckpointFiles,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let config = CheckpointConfig::parse(&files.config)?;
        agree("spec", config.spec_digest.as_str(), spec_digest)?;
        agree("samples", &config.samples, &data.samples)?;
        agree("context", &config.context, &spec.context)?;
        agree("joints", &config.joints, &data.joints)?;
        if config.ema != spec.ema {
            let (found, expected) = (format!("{:?}", config.ema), format!("{:?}", spec.ema));
            return Err(ModelError::OtherTraining { field: "ema", found, expected });
        }
        if config.model != spec.model {
            let (found, expected) = (format!("{:?}", config.model), format!("{:?}", spec.model));
            return Err(ModelError::OtherTraining { field: "model", found, expected });
        }
        data.statistics = config.normalizer.statistics();
        let mut trainer = Self::new(spec, data, spec_digest, device)?;
        let kept = checkpoint::load_weights(trainer.model, &files.model)?;
        let mut state = TrainingState::read(&files.optimizer)?;
        trainer.average = spec.ema.map(|ema| WeightAverage::new(ema, &kept));
        let model = if spec.ema.is_some() { state.weights(kept)? } else { kept };
        trainer.model = freeze(model, &spec.frozen)?;
        trainer.optimizer = state.optimizer(&spec.optimizer, &trainer.model, config.step)?;
        trainer.metrics = config.metrics;
        trainer.ranges = config.ranges;
        trainer.identity.init = config.init;
        trainer.step = config.step;
        Ok(trainer)
    }

    /// Lets `interrupt` end steps and validations with [`ModelError::Interrupted`].
    #[must_use]
    pub fn interrupted_by(self, interrupt: Interrupt) -> Self {
        Self { interrupt, ..self }
    }

    /// Writes the limits of the robot's joints, rad, into checkpoints, so that predictions beyond
    /// them get a warning. The model does not see them.
    #[must_use]
    pub fn with_limits(self, limits_rad: Vec<Range>) -> Self {
        Self { limits_rad, ..self }
    }

    /// Steps taken.
    pub fn steps_done(&self) -> u64 {
        self.step
    }

    /// Takes one optimizer step on `batch`.
    ///
    /// # Errors
    /// The batch has the wrong shape or values that are not finite. [`ModelError::LossNotFinite`],
    /// [`ModelError::GradientNotFinite`] and [`ModelError::Interrupted`] leave the trainer as it
    /// was.
    pub fn step(&mut self, batch: &Series) -> Result<StepReport, ModelError> {
        let step = self.step + 1;
        if self.step == 0 && self.identity.init.is_none() {
            self.begin(batch)?;
        }
        let (gradients, loss) = self.compute(|| self.gradients(batch))?;
        let gradient_norm = gradients.norm;
        let learning_rate = self.schedule.learning_rate(self.step);
        if !gradient_norm.is_finite() {
            return Err(ModelError::GradientNotFinite { step, gradient_norm, loss, learning_rate });
        }
        let Self { device, model, optimizer, average, .. } = self;
        device.train(|| {
            *model = optimizer.step(model.clone(), gradients, learning_rate);
            if let Some(average) = average {
                average.update(model, step);
            }
        });
        // A checkpoint without ranges lacks those of its earlier batches.
        let is_first = self.step == 0 && self.identity.init.is_none();
        if is_first || self.ranges.is_some() {
            let of_batch = DataRanges::of(&batch.view());
            let of_batch = of_batch.map(|ranges| ranges.given(self.identity.given));
            let seen = self.ranges.take().into_iter().chain(of_batch);
            self.ranges = seen.reduce(DataRanges::and);
        }
        self.step = step;
        self.metrics.clear();
        self.note(TRAIN_LOSS, loss);
        Ok(StepReport { step, loss, gradient_norm, learning_rate })
    }

    /// Lets the model read off the first batch what it wants to know before its first step. A second
    /// call changes nothing.
    fn begin(&mut self, batch: &Series) -> Result<(), ModelError> {
        let model = self.compute(|| {
            check_batch(&batch.view(), self.framing.samples, self.joints)?;
            let device = self.device.inference();
            let (input, _) = self.input(&batch.view(), self.framing, &device);
            Ok(self.model.clone().begin(&input, self.identity.seed))
        })?;
        self.average = self.identity.ema.map(|ema| WeightAverage::new(ema, &model));
        self.model = model;
        Ok(())
    }

    /// Runs `work` where the device computes.
    fn compute<T: Send>(
        &self,
        work: impl FnOnce() -> Result<T, ModelError> + Send,
    ) -> Result<T, ModelError> {
        self.device.train(|| self.interrupt.guard(work))
    }

    /// The gradients of the next step, and its loss.
    fn gradients(&self, batch: &Series) -> Result<(NamedGradients, f64), ModelError> {
        check_batch(&batch.view(), self.framing.samples, self.joints)?;
        let step = self.step + 1;
        let framing = Framing { context: self.context_of_step(step), ..self.framing };
        let device = self.device.training();
        let size = batch.robots();
        let micro_batches = self.micro_batching.of_batch(size);
        let part = |model: &SequenceModel, index: usize| {
            let first = index * micro_batches.size;
            let part = batch.part(first..(first + micro_batches.size).min(size));
            let share = part.robots() as f64 / size as f64;
            let dropout = self.generators(Purpose::Dropout, step, first, part.robots());
            let training = self.generators(Purpose::Training, step, first, part.robots());
            let mut noise = Noise::new(training).with_dropout(dropout);
            let loss = self.loss(model, &part, framing, &mut noise, &device)?;
            let value = share * loss.value()?;
            if !value.is_finite() {
                return Ok(GradientSum::without_gradients(value));
            }
            let tensor = loss.tensor();
            let tensor = if micro_batches.count == 1 { tensor } else { tensor * share };
            Ok(GradientSum::of(model, value, tensor.backward()))
        };
        // Interrupts are known to each thread apart.
        let part = |model: &SequenceModel, index| self.interrupt.guard(|| part(model, index));
        let sum = gradient_sum::over_micro_batches(
            &self.model,
            micro_batches.count,
            micro_batches.at_once,
            part,
        )?;
        let loss = sum.loss();
        if !loss.is_finite() {
            let learning_rate = self.schedule.learning_rate(self.step);
            return Err(ModelError::LossNotFinite { step, loss, learning_rate });
        }
        Ok((sum.named()?, loss))
    }

    /// Writes `value` into checkpoints of this step.
    pub fn note(&mut self, metric: &str, value: f64) {
        // JSON has no NaN and no infinity.
        if value.is_finite() {
            self.metrics.insert(metric.to_owned(), value);
        }
    }

    /// The loss of the last step, and the values noted after it.
    pub fn metrics(&self) -> &BTreeMap<String, f64> {
        &self.metrics
    }

    /// Loss and error on `part`, with the averaged weights where there are any. The trainer does
    /// not change.
    ///
    /// # Errors
    /// Those of [`Trainer::step`]. A loss that is not finite is a result and no error.
    pub fn validate(&self, part: &ValidationPart<'_>) -> Result<ValidationReport, ModelError> {
        self.compute(|| self.validated(part))
    }

    fn validated(&self, part: &ValidationPart<'_>) -> Result<ValidationReport, ModelError> {
        let ValidationPart { batch, first, predicted } = part;
        check_batch(batch, self.framing.samples, self.joints)?;
        let model = self.kept_model();
        let device = self.device.inference();
        let context = self.framing.context;
        let mut noise = Noise::new(self.generators(Purpose::Validation, 0, *first, batch.robots()));
        let loss = self.loss(&model, batch, self.framing, &mut noise, &device)?;
        let mut report = ValidationReport::new(loss.value()?, batch.robots());
        if let Some(answer) = loss.predicted {
            let statistics = self.normalizer.statistics_of_batch(batch, context);
            let observed = batch.observed(0, context);
            let frames = self.framing.frames(&observed, &statistics);
            let mut answer = host_values(answer)?;
            let rows = answer.chunks_exact_mut(observed.horizon() * observed.joints());
            for (y, frame) in rows.zip(&frames) {
                frame.restore(y, context);
            }
            report.add_predictions(&answer, batch, context);
        } else if *predicted > 0 {
            let asked = batch.part(0..batch.robots().min(*predicted));
            let statistics = self.normalizer.statistics_of_batch(&asked, context);
            let (spec, framing) = (&self.identity.model, self.framing);
            let predictor = Predictor { model: &model, spec, framing, device, behind: 0 };
            let sampling = Sampling { first_scenario: *first as u64, ..Sampling::default() };
            let observed = asked.observed(0, context);
            let answer = predictor.answer(&observed, &statistics, &sampling, Draw::Mean)?;
            report.add_predictions(&answer, &asked, context);
        }
        Ok(report)
    }

    /// The model with the weights that predict.
    fn kept_model(&self) -> SequenceModel {
        match &self.average {
            Some(average) => average.model(&self.model),
            None => self.model.for_inference(),
        }
    }

    /// A checkpoint for [`Trainer::resume`] and [`crate::TrainedModel::load`].
    ///
    /// # Errors
    /// [`ModelError::NotFiniteTensor`] if a tensor has a value that is not finite.
    pub fn checkpoint(&self) -> Result<CheckpointFiles, ModelError> {
        let Identity { model, context, data, seed, spec_digest, dataset_digest, ema, given, init } =
            &self.identity;
        let extents = Extents::new(*context, data.samples, data.joints)?;
        let config = CheckpointConfig {
            format_version: FORMAT_VERSION,
            parameters: parameter_count(model, extents)?,
            model: model.clone(),
            context: *context,
            horizon: extents.horizon,
            samples: data.samples,
            joints: data.joints,
            rate_hz: data.rate_hz,
            normalizer: self.normalizer.clone(),
            step: self.step,
            seed: *seed,
            spec_digest: spec_digest.clone(),
            dataset_digest: dataset_digest.clone(),
            given: *given,
            init: init.clone(),
            ranges: self.ranges.clone(),
            limits_rad: self.limits_rad.clone(),
            ema: *ema,
            metrics: self.metrics.clone(),
            device: Some(self.device.description().clone()),
            versions: Versions::current(),
        };
        let average = self.average.as_ref().map(|average| average.model(&self.model));
        checkpoint::write(&self.model, average.as_ref(), &self.optimizer, &config)
    }

    /// The context of a step in samples. A model for many lengths gets a random one, uniform over
    /// all.
    fn context_of_step(&self, step: u64) -> usize {
        let Identity { model, context, seed, .. } = &self.identity;
        let Lengths::From(least) = model.lengths() else { return self.framing.context };
        let patch = model.patch() as usize;
        let choices = (context.saturating_sub(least) as usize) / patch + 1;
        let drawn = Noise::new([generator(*seed, Purpose::Cut, step, 0)]).below(choices);
        least as usize + patch * drawn.iter().sum::<usize>()
    }

    /// Generators for the trajectories `first..first + size` of a batch.
    fn generators(
        &self,
        purpose: Purpose,
        step: u64,
        first: usize,
        size: usize,
    ) -> impl Iterator<Item = ChaCha12Rng> {
        let seed = self.identity.seed;
        let rows = first..first + size;
        rows.map(move |trajectory| generator(seed, purpose, step, trajectory as u64))
    }

    fn loss(
        &self,
        model: &SequenceModel,
        batch: &SeriesView<'_>,
        framing: Framing,
        noise: &mut Noise,
        device: &burn::tensor::Device,
    ) -> Result<Loss, ModelError> {
        let (input, frames) = self.input(batch, framing, device);
        let loss = model.loss(input, target(batch, &frames, framing.context, device), noise);
        Ok(match &self.loss_weights {
            Some(weights) => loss.weighted(weights),
            None => loss,
        })
    }

    /// The input of the model, and the frame of each robot's answer.
    fn input(
        &self,
        batch: &SeriesView<'_>,
        framing: Framing,
        device: &burn::tensor::Device,
    ) -> (ModelInput, Vec<Frame>) {
        let statistics = self.normalizer.statistics_of_batch(batch, framing.context);
        let observed = batch.observed(0, framing.context);
        let frames = framing.frames(&observed, &statistics);
        (model_input(&observed, &statistics, &frames, device), frames)
    }
}

/// The digest of the data's spec: of a dataset, that of the job that makes it. Ids and names of a
/// spec that was not submitted have none.
fn digest_of(data: &DataSources) -> Option<String> {
    match data {
        DataSources::One(DataSource::Digest(digest)) => Some(digest.to_string()),
        DataSources::One(DataSource::Job(_) | DataSource::Dataset(_)) => None,
        DataSources::One(DataSource::Stream(_)) | DataSources::Each(_) => {
            let value = serde_json::to_value(data).unwrap_or_default();
            Some(Digest::of_json(&value).to_string())
        }
    }
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
