use kernels::Interrupt;
use series::{Observed, SeriesView};
use spec::{Length, ModelSpec};

use crate::architecture::Draw;
use crate::checkpoint::{self, CheckpointConfig, CheckpointFiles};
use crate::frame::Framing;
use crate::initialization::InitialWeights;
use crate::normalization::{Normalizer, Statistics};
use crate::prediction::Predictor;
use crate::sequence_model::SequenceModel;
use crate::shapes::{check_batch, check_observed};
use crate::{Device, ModelError, Sampling};

/// A model that only predicts. Can be shared between threads.
#[derive(Debug)]
pub struct TrainedModel {
    model: SequenceModel,
    normalizer: Normalizer,
    config: CheckpointConfig,
    device: Device,
}

impl TrainedModel {
    /// From the bytes of a checkpoint's [`crate::MODEL_FILE`] and [`crate::CONFIG_FILE`].
    ///
    /// # Errors
    /// Files that are damaged, do not belong together, or are from a newer torqued.
    pub fn load(weights: &[u8], config: &[u8], device: &Device) -> Result<Self, ModelError> {
        let config = CheckpointConfig::parse(config)?;
        checkpoint::check_size(&config, weights)?;
        let inference = device.inference();
        let mut initial = InitialWeights::none(&inference);
        let model = SequenceModel::new(&config.model, config.extents(), &mut initial)?;
        Ok(Self {
            model: checkpoint::load_weights(model, weights)?,
            normalizer: config.normalizer.clone(),
            config,
            device: device.clone(),
        })
    }

    pub fn from_files(files: &CheckpointFiles, device: &Device) -> Result<Self, ModelError> {
        Self::load(&files.model, &files.config, device)
    }

    /// Positions of the horizon, `[robot, horizon, joint]`, rad. Of a gaussian head the mean, of a
    /// denoiser the sample of [`Sampling::default`].
    ///
    /// # Errors
    /// [`ModelError::LeakRequired`] for a model with normalization `paper-leaky`; an input of
    /// another shape or with values that are not finite.
    pub fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, ModelError> {
        self.predict_with(observed, &Sampling::default())
    }

    /// As [`TrainedModel::predict`], of a denoiser the one sample that `sampling` asks for.
    ///
    /// # Errors
    /// As [`TrainedModel::predict`]; [`ModelError::Sampling`] and [`ModelError::Spec`] for what this
    /// model cannot do.
    pub fn predict_with(
        &self,
        observed: &Observed<'_>,
        sampling: &Sampling,
    ) -> Result<Vec<f32>, ModelError> {
        self.ask(observed, &Sampling { samples: 1, ..sampling.clone() }, Draw::Mean)
    }

    /// Positions of the horizon in several ways, `[sample, robot, horizon, joint]`, rad. Sample k of a
    /// scenario depends on (seed, scenario, k) alone, not on what else is asked.
    ///
    /// # Errors
    /// As [`TrainedModel::predict`]; [`ModelError::NotGenerative`] for a model that has one answer
    /// only, [`ModelError::Sampling`] and [`ModelError::Spec`] for what this one cannot do.
    pub fn sample(
        &self,
        observed: &Observed<'_>,
        sampling: &Sampling,
    ) -> Result<Vec<f32>, ModelError> {
        if !self.is_generative() {
            return Err(ModelError::NotGenerative);
        }
        self.ask(observed, sampling, Draw::Sample)
    }

    /// As [`TrainedModel::predict`], except that normalization `paper-leaky` takes its statistics
    /// from the whole trajectory, the horizon's y included, as the paper's code does. No other
    /// use is made of the horizon's y.
    pub fn predict_with_leak(&self, batch: &SeriesView<'_>) -> Result<Vec<f32>, ModelError> {
        check_batch(batch, self.samples(), self.joints())?;
        let statistics = self.normalizer.statistics_of_batch(batch, self.context());
        let observed = batch.observed(0, self.context());
        self.answer(&observed, &statistics, &Sampling::default(), Draw::Mean)
    }

    /// Whether it can answer the same question in several ways.
    pub fn is_generative(&self) -> bool {
        self.model.is_generative()
    }

    /// Whether this model needs the future to predict it.
    pub fn needs_leak(&self) -> bool {
        self.normalizer == Normalizer::PaperLeaky
    }

    /// Samples the model is given.
    pub fn context(&self) -> usize {
        self.config.context as usize
    }

    /// Samples the model predicts.
    pub fn horizon(&self) -> usize {
        self.config.horizon as usize
    }

    /// The fewest samples, at least `steps` and at most [`TrainedModel::horizon`], that it can be asked to predict after
    /// its context.
    pub fn horizon_of(&self, steps: usize) -> usize {
        let CheckpointConfig { model, context, samples, .. } = &self.config;
        let whole = u32::try_from(steps).unwrap_or(*samples).next_multiple_of(model.patch());
        let asked = Length { context: *context, samples: context.saturating_add(whole) };
        let trained = Length { context: *context, samples: *samples };
        let nearest = model.lengths().nearest(asked, trained, model.patch());
        (nearest.samples - nearest.context) as usize
    }

    /// Context and horizon together.
    pub fn samples(&self) -> usize {
        self.config.samples as usize
    }

    /// Joints of the arm that it was trained on.
    pub fn joints(&self) -> usize {
        self.config.joints
    }

    pub fn rate_hz(&self) -> f64 {
        self.config.rate_hz
    }

    pub fn architecture(&self) -> &ModelSpec {
        &self.config.model
    }

    pub fn config(&self) -> &CheckpointConfig {
        &self.config
    }

    fn ask(
        &self,
        observed: &Observed<'_>,
        sampling: &Sampling,
        draw: Draw,
    ) -> Result<Vec<f32>, ModelError> {
        let CheckpointConfig { model, context, samples, .. } = &self.config;
        let trained = Length { context: *context, samples: *samples };
        check_observed(observed, model, trained, self.joints())?;
        let statistics = self.normalizer.statistics_of_observed(observed)?;
        self.answer(observed, &statistics, sampling, draw)
    }

    fn answer(
        &self,
        observed: &Observed<'_>,
        statistics: &[Statistics],
        sampling: &Sampling,
        draw: Draw,
    ) -> Result<Vec<f32>, ModelError> {
        let predictor = Predictor {
            model: &self.model,
            spec: &self.config.model,
            framing: Framing {
                residual: self.config.model.residual(),
                samples: observed.samples(),
                context: observed.context(),
                rate_hz: self.rate_hz(),
            },
            device: self.device.inference(),
        };
        let interrupt = Interrupt::current();
        let answer = || predictor.answer(observed, statistics, sampling, draw);
        // On a thread of the pool, which then wakes no other for each parallel loop.
        rayon::scope(|_| interrupt.guard(answer))
    }
}
