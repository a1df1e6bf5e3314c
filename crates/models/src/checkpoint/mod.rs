//! A checkpoint: three files that PyTorch users can open too.
//!
//! | file | content |
//! |---|---|
//! | `model.safetensors` | the parameters, names and layouts as in `torch.nn` |
//! | `optimizer.safetensors` | Adam's moments, `exp_avg.NAME` and `exp_avg_sq.NAME` |
//! | `config.json` | [`CheckpointConfig`] |
//!
//! With averaged weights, `model.safetensors` holds the average, which predicts, and
//! `optimizer.safetensors` also holds the weights in training, as `weights.NAME`.
//!
//! There is no generator state, because random numbers are keyed by seed and step. Reading
//! arbitrary bytes ends in a value or an error. Sizes are compared with the length of the bytes
//! before anything is allocated for them.

mod config;
mod tensors;

use spec::OptimizerSpec;

use crate::ModelError;
use crate::memory::parameter_count;
use crate::optimizer::ModelOptimizer;
use crate::parameters::{NamedTensor, NamedTensors, parameters, with_parameters};
use crate::sequence_model::SequenceModel;

pub use config::{CheckpointConfig, FORMAT_VERSION, Origin, Versions};

/// The file with the weights.
pub const MODEL_FILE: &str = "model.safetensors";
/// The file with the state of the optimizer, from which a training resumes.
pub const OPTIMIZER_FILE: &str = "optimizer.safetensors";
/// The file with the [`CheckpointConfig`].
pub const CONFIG_FILE: &str = "config.json";

/// The bytes of a checkpoint's files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckpointFiles {
    /// Bytes of [`MODEL_FILE`].
    pub model: Vec<u8>,
    /// Bytes of [`OPTIMIZER_FILE`].
    pub optimizer: Vec<u8>,
    /// Bytes of [`CONFIG_FILE`].
    pub config: Vec<u8>,
}

/// The files of a checkpoint that a fine-tuning begins from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InitialCheckpoint {
    /// Bytes of [`MODEL_FILE`].
    pub model: Vec<u8>,
    /// Bytes of [`CONFIG_FILE`].
    pub config: Vec<u8>,
}

impl CheckpointFiles {
    /// Each file's name and bytes.
    pub fn named(&self) -> [(&'static str, &[u8]); 3] {
        [(MODEL_FILE, &self.model), (OPTIMIZER_FILE, &self.optimizer), (CONFIG_FILE, &self.config)]
    }

    /// Each file's name and bytes, by value.
    pub fn into_named(self) -> [(&'static str, Vec<u8>); 3] {
        [(MODEL_FILE, self.model), (OPTIMIZER_FILE, self.optimizer), (CONFIG_FILE, self.config)]
    }
}

/// Prefix of the weights in training in the optimizer's file.
const WEIGHTS: &str = "weights.";

/// Writes the files. `average` has the averaged weights of `model`, where there are any.
pub(crate) fn write(
    model: &SequenceModel,
    average: Option<&SequenceModel>,
    optimizer: &ModelOptimizer,
    config: &CheckpointConfig,
) -> Result<CheckpointFiles, ModelError> {
    let mut state = optimizer.state(model)?;
    if average.is_some() {
        state.extend(
            parameters(model)?
                .into_iter()
                .map(|(name, tensor)| (format!("{WEIGHTS}{name}"), tensor)),
        );
    }
    Ok(CheckpointFiles {
        model: tensors::encode(MODEL_FILE, &parameters(average.unwrap_or(model))?)?,
        optimizer: tensors::encode(OPTIMIZER_FILE, &state)?,
        config: config.to_json()?,
    })
}

/// Checks that `weights` is long enough for the parameters of `config`, before they are allocated.
pub(crate) fn check_size(config: &CheckpointConfig, weights: &[u8]) -> Result<(), ModelError> {
    let parameters = parameter_count(&config.model, config.extents())?;
    let needed = parameters * size_of::<f32>() as u64;
    if needed <= weights.len() as u64 {
        return Ok(());
    }
    let found = weights.len();
    let reason = format!(
        "has {found} bytes, too few for the {parameters} parameters of the model in {CONFIG_FILE}"
    );
    Err(ModelError::CheckpointFile { file: MODEL_FILE, reason })
}

pub(crate) fn load_weights(
    model: SequenceModel,
    bytes: &[u8],
) -> Result<SequenceModel, ModelError> {
    let tensors = tensors::decode(MODEL_FILE, bytes)?;
    with_parameters(model, tensors)
        .map_err(|reason| ModelError::CheckpointFile { file: MODEL_FILE, reason })
}

/// The content of the optimizer's file.
pub(crate) struct TrainingState {
    moments: NamedTensors,
    /// Empty without averaged weights.
    weights: NamedTensors,
}

impl TrainingState {
    pub fn read(bytes: &[u8]) -> Result<Self, ModelError> {
        let (mut moments, mut weights) = (NamedTensors::new(), NamedTensors::new());
        for (name, tensor) in tensors::decode(OPTIMIZER_FILE, bytes)? {
            match name.strip_prefix(WEIGHTS) {
                Some(name) => weights.insert(name.to_owned(), tensor),
                None => moments.insert(name, tensor),
            };
        }
        Ok(Self { moments, weights })
    }

    /// `model` with the weights in training. They differ from the averaged ones, which predict.
    pub fn weights(&mut self, model: SequenceModel) -> Result<SequenceModel, ModelError> {
        with_parameters(model, std::mem::take(&mut self.weights)).map_err(damaged_optimizer)
    }

    /// The optimizer of `model` after `steps` steps.
    pub fn optimizer(
        self,
        spec: &OptimizerSpec,
        model: &SequenceModel,
        steps: u64,
    ) -> Result<ModelOptimizer, ModelError> {
        if let Some(name) = self.weights.keys().next() {
            let reason = format!(
                "tensor `{WEIGHTS}{name}` belongs to a training with averaged weights, and \
                 {CONFIG_FILE} has no `ema`"
            );
            return Err(damaged_optimizer(reason));
        }
        let negative = |(name, tensor): (&String, &NamedTensor)| {
            let is_square = name.starts_with(crate::optimizer::SECOND_MOMENT);
            (is_square && tensor.values.iter().any(|&value| value < 0.0)).then(|| name.clone())
        };
        if let Some(name) = self.moments.iter().find_map(negative) {
            return Err(damaged_optimizer(format!("tensor `{name}` has a value below 0")));
        }
        // Adam's bias correction raises its betas to this power, an `i32` in burn.
        let steps =
            i32::try_from(steps).ok().and_then(|steps| usize::try_from(steps).ok()).ok_or_else(
                || damaged_optimizer(format!("step is {steps}, Adam allows up to {}", i32::MAX)),
            )?;
        ModelOptimizer::from_state(spec, model, self.moments, steps).map_err(damaged_optimizer)
    }
}

fn damaged_optimizer(reason: String) -> ModelError {
    ModelError::CheckpointFile { file: OPTIMIZER_FILE, reason }
}
