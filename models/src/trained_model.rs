use spec::{JOINTS, ModelSpec};

use crate::checkpoint::{self, CheckpointConfig, CheckpointFiles};
use crate::initialization::InitialWeights;
use crate::normalization::{Normalizer, Statistics, denormalize, model_input};
use crate::parameters::host_values;
use crate::sequence_model::SequenceModel;
use crate::{Batch, Device, ModelError, PredictionInput};

/// Trajectories computed at once, so that memory does not grow with the question.
const CHUNK: usize = 64;

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
        let model = SequenceModel::new(
            &config.model,
            config.context,
            config.horizon,
            &mut InitialWeights::new(config.seed, &inference),
        )?;
        Ok(Self {
            model: checkpoint::load_weights(model, weights)?,
            normalizer: config.normalizer,
            config,
            device: device.clone(),
        })
    }

    pub fn from_files(files: &CheckpointFiles, device: &Device) -> Result<Self, ModelError> {
        Self::load(&files.model, &files.config, device)
    }

    /// Positions of the horizon, `[size, horizon, 7]`, rad.
    ///
    /// # Errors
    /// [`ModelError::LeakRequired`] for a model with normalization `paper-leaky`; an input of
    /// another shape or with values that are not finite.
    pub fn predict(&self, input: &PredictionInput) -> Result<Vec<f32>, ModelError> {
        input.check(self.samples(), self.context())?;
        let statistics =
            self.normalizer.statistics_of_input(input, self.samples(), self.context())?;
        rayon::scope(|_| self.answer(input, &statistics))
    }

    /// As [`TrainedModel::predict`], except that normalization `paper-leaky` takes its statistics
    /// from the whole trajectory, the horizon's y included, as the paper's code does. No other
    /// use is made of the horizon's y.
    pub fn predict_with_leak(&self, batch: &Batch) -> Result<Vec<f32>, ModelError> {
        batch.check(self.samples())?;
        let statistics = self.normalizer.statistics_of_batch(batch, self.context());
        rayon::scope(|_| self.answer(&batch.known(self.context()), &statistics))
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

    /// Context and horizon together.
    pub fn samples(&self) -> usize {
        self.config.samples as usize
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

    fn answer(
        &self,
        input: &PredictionInput,
        statistics: &[Statistics],
    ) -> Result<Vec<f32>, ModelError> {
        let device = self.device.inference();
        let (samples, context, horizon) = (self.samples(), self.context(), self.horizon());
        let mut answer = Vec::with_capacity(input.size * horizon * JOINTS);
        let torques = input.u.chunks(CHUNK * samples * JOINTS);
        let positions = input.y_context.chunks(CHUNK * context * JOINTS);
        for ((u, y), statistics) in torques.zip(positions).zip(statistics.chunks(CHUNK)) {
            let chunk =
                PredictionInput { u: u.to_vec(), y_context: y.to_vec(), size: statistics.len() };
            let input = model_input(&chunk, statistics, samples, context, &device);
            let mut predicted = host_values(self.model.forward(input))?;
            denormalize(&mut predicted, statistics, horizon);
            answer.extend(predicted);
        }
        Ok(answer)
    }
}
