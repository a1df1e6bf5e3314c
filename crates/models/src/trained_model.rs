//! A model that predicts, from the files of a checkpoint.

use kernels::Interrupt;
use rayon::prelude::*;
use series::{Decimated, JointMotion, Observed, SeriesView};
use spec::{Length, ModelSpec};
use wire::Warning;

use crate::architecture::{Draw, FittedRobot};
use crate::checkpoint::{self, CheckpointConfig, CheckpointFiles};
use crate::frame::Framing;
use crate::initialization::InitialWeights;
use crate::normalization::{Normalizer, Statistics};
use crate::prediction::Predictor;
use crate::sequence_model::SequenceModel;
use crate::shapes::{check_batch, check_observed};
use crate::{Device, ModelError, Sampling};

/// A trained model for predictions. Threads can share it.
#[derive(Debug)]
pub struct TrainedModel {
    model: SequenceModel,
    normalizer: Normalizer,
    config: CheckpointConfig,
    device: Device,
}

impl TrainedModel {
    /// Loads a model from the bytes of a checkpoint's [`crate::MODEL_FILE`] and
    /// [`crate::CONFIG_FILE`].
    ///
    /// # Errors
    /// The files are damaged, do not belong together, or come from a newer torqued.
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

    /// The model of the files of a checkpoint.
    ///
    /// # Errors
    /// Those of [`TrainedModel::load`].
    pub fn from_files(files: &CheckpointFiles, device: &Device) -> Result<Self, ModelError> {
        Self::load(&files.model, &files.config, device)
    }

    /// Positions of the horizon, `[robot, horizon, joint]`, rad. A gaussian head gives its mean,
    /// and a denoiser the sample of [`Sampling::default`].
    ///
    /// # Errors
    /// [`ModelError::LeakRequired`] for a model with normalization `paper-leaky`. Other errors for
    /// an input of another shape or with values that are not finite.
    pub fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, ModelError> {
        self.predict_with(observed, &Sampling::default())
    }

    /// Like [`TrainedModel::predict`], but a denoiser draws the single sample of `sampling`.
    ///
    /// # Errors
    /// Those of [`TrainedModel::predict`], and [`ModelError::Sampling`] or [`ModelError::Spec`] for
    /// a `sampling` that this model does not support.
    pub fn predict_with(
        &self,
        observed: &Observed<'_>,
        sampling: &Sampling,
    ) -> Result<Vec<f32>, ModelError> {
        self.ask(observed, &Sampling { samples: 1, ..sampling.clone() }, Draw::Mean)
    }

    /// Several samples of the horizon's positions, `[sample, robot, horizon, joint]`, rad. Sample k
    /// of a scenario depends only on (seed, scenario, k), and not on the rest of the call.
    ///
    /// # Errors
    /// Those of [`TrainedModel::predict`], [`ModelError::NotGenerative`] for a model with a single
    /// answer, and [`ModelError::Sampling`] or [`ModelError::Spec`] for a `sampling` that this
    /// model does not support.
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

    /// The robots by which the model explains the contexts, each of which says the torques of
    /// motions. `None` for a model without a law of torques: of all architectures only `lagrangian`
    /// has one.
    ///
    /// # Errors
    /// Those of [`TrainedModel::predict`].
    pub fn fit(&self, observed: &Observed<'_>) -> Result<Option<Vec<FittedRobot>>, ModelError> {
        // Others need not answer questions about so short a horizon.
        if !self.config.model.is_physical() {
            return Ok(None);
        }
        if let Some(decimated) = self.decimated(observed)? {
            return self.fit(&decimated.observed());
        }
        let statistics = self.statistics(observed)?;
        let predictor = self.predictor(observed, 0);
        let interrupt = Interrupt::current();
        self.device.answer(|| interrupt.guard(|| Ok(predictor.fit(observed, &statistics))))
    }

    /// The torques that a motion of each robot takes, `[instant, joint]`, N·m, of the robots of
    /// [`TrainedModel::fit`].
    ///
    /// # Errors
    /// Those of [`TrainedModel::predict`].
    pub fn torques(
        &self,
        observed: &Observed<'_>,
        motions: &[JointMotion],
    ) -> Result<Option<Vec<Vec<f32>>>, ModelError> {
        let fitted = self.fit(observed)?;
        let of = |(robot, motion): (&FittedRobot, &JointMotion)| robot(motion);
        Ok(fitted.map(|robots| robots.par_iter().zip(motions).map(of).collect()))
    }

    /// Like [`TrainedModel::predict`], but with the whole trajectory, the horizon's y included.
    /// Normalization `paper-leaky` takes its statistics from it, as the paper's code does. The
    /// horizon's y has no other use.
    pub fn predict_with_leak(&self, batch: &SeriesView<'_>) -> Result<Vec<f32>, ModelError> {
        check_batch(batch, self.samples(), self.joints())?;
        let statistics = self.normalizer.statistics_of_batch(batch, self.context());
        let observed = batch.observed(0, self.context());
        self.answer(&observed, &statistics, &Sampling::default(), Draw::Mean, 0)
    }

    /// Whether the model can give several answers to the same question.
    pub fn is_generative(&self) -> bool {
        self.model.is_generative()
    }

    /// Whether the model needs the horizon's y for its predictions.
    pub fn needs_leak(&self) -> bool {
        self.normalizer == Normalizer::PaperLeaky
    }

    /// Samples of the context.
    pub fn context(&self) -> usize {
        self.config.context as usize
    }

    /// Samples of the horizon.
    pub fn horizon(&self) -> usize {
        self.config.horizon as usize
    }

    /// The shortest horizon that this model can predict with at least `steps` samples. It is at
    /// most [`TrainedModel::horizon`].
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

    /// Joints of the arm in the training.
    pub fn joints(&self) -> usize {
        self.config.joints
    }

    /// Samples per second of the trajectories that it was trained on.
    pub fn rate_hz(&self) -> f64 {
        self.config.rate_hz
    }

    /// The architecture and its sizes.
    pub fn architecture(&self) -> &ModelSpec {
        &self.config.model
    }

    /// The checkpoint's description.
    pub fn config(&self) -> &CheckpointConfig {
        &self.config
    }

    fn ask(
        &self,
        observed: &Observed<'_>,
        sampling: &Sampling,
        draw: Draw,
    ) -> Result<Vec<f32>, ModelError> {
        if let Some(decimated) = self.decimated(observed)? {
            let observed = decimated.observed();
            let statistics = self.statistics(&observed)?;
            let behind = Decimated::BEHIND;
            let answer = self.answer(&observed, &statistics, sampling, draw, behind)?;
            return Ok(decimated.restored(&answer));
        }
        let statistics = self.statistics(observed)?;
        self.answer(observed, &statistics, sampling, draw, 0)
    }

    /// Warnings about a question that is unlike the training, for a checkpoint that knows the ranges
    /// of its training.
    ///
    /// # Errors
    /// The series are too large.
    pub fn warnings(&self, observed: &Observed<'_>) -> Result<Vec<Warning>, ModelError> {
        let Some(ranges) = &self.config.ranges else { return Ok(Vec::new()) };
        let decimated = self.decimated(observed)?;
        Ok(match &decimated {
            Some(decimated) => ranges.warnings(&decimated.observed()),
            None => ranges.warnings(observed),
        })
    }

    /// The question at the rate of the training, for a model that answers at multiples of it. `None`
    /// if the question has that rate already.
    ///
    /// # Errors
    /// The series are too large.
    fn decimated(&self, observed: &Observed<'_>) -> Result<Option<Decimated>, ModelError> {
        let multiple = self.config.model.multiple(self.rate_hz(), observed.rate_hz());
        Ok(Decimated::new(observed, multiple.unwrap_or(1))?)
    }

    /// Checks a question, and gives what its series are normalized with.
    fn statistics(&self, observed: &Observed<'_>) -> Result<Vec<Statistics>, ModelError> {
        let CheckpointConfig { model, context, samples, .. } = &self.config;
        let trained = Length { context: *context, samples: *samples };
        check_observed(observed, model, trained, self.joints())?;
        self.normalizer.statistics_of_observed(observed)
    }

    fn predictor(&self, observed: &Observed<'_>, behind: usize) -> Predictor<'_> {
        Predictor {
            model: &self.model,
            spec: &self.config.model,
            framing: Framing {
                residual: self.config.model.residual(),
                samples: observed.samples(),
                context: observed.context(),
                rate_hz: self.rate_hz(),
            },
            device: self.device.inference(),
            behind,
        }
    }

    fn answer(
        &self,
        observed: &Observed<'_>,
        statistics: &[Statistics],
        sampling: &Sampling,
        draw: Draw,
        behind: usize,
    ) -> Result<Vec<f32>, ModelError> {
        let predictor = self.predictor(observed, behind);
        let interrupt = Interrupt::current();
        let answer = || predictor.answer(observed, statistics, sampling, draw);
        self.device.answer(|| interrupt.guard(answer))
    }
}
