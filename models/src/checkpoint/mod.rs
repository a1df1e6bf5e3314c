//! A checkpoint: three files that PyTorch users can open too.
//!
//! | file | content |
//! |---|---|
//! | `model.safetensors` | the parameters, names and layouts as in `torch.nn` |
//! | `optimizer.safetensors` | Adam's moments, `exp_avg.NAME` and `exp_avg_sq.NAME` |
//! | `config.json` | [`CheckpointConfig`] |
//!
//! There is no generator state: training draws nothing at random but the initial weights.
//! Whatever the bytes, reading them ends in a value or an error; sizes are compared with the
//! bytes that are there before anything is allocated for them.

mod config;
mod tensors;

use spec::OptimizerSpec;

use crate::ModelError;
use crate::optimizer::ModelOptimizer;
use crate::parameters::{parameters, with_parameters};
use crate::sequence_model::SequenceModel;

pub use config::{CheckpointConfig, FORMAT_VERSION, Versions};

pub const MODEL_FILE: &str = "model.safetensors";
pub const OPTIMIZER_FILE: &str = "optimizer.safetensors";
pub const CONFIG_FILE: &str = "config.json";

/// The bytes of a checkpoint's files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckpointFiles {
    pub model: Vec<u8>,
    pub optimizer: Vec<u8>,
    pub config: Vec<u8>,
}

impl CheckpointFiles {
    /// Each file's name and bytes.
    pub fn named(&self) -> [(&'static str, &[u8]); 3] {
        [(MODEL_FILE, &self.model), (OPTIMIZER_FILE, &self.optimizer), (CONFIG_FILE, &self.config)]
    }
}

pub(crate) fn write(
    model: &SequenceModel,
    optimizer: &ModelOptimizer,
    config: &CheckpointConfig,
) -> Result<CheckpointFiles, ModelError> {
    Ok(CheckpointFiles {
        model: tensors::encode(MODEL_FILE, &parameters(model)?)?,
        optimizer: tensors::encode(OPTIMIZER_FILE, &optimizer.state(model)?)?,
        config: config.to_json()?,
    })
}

/// Whether `weights` can hold the parameters that `config` speaks of, before they are made.
pub(crate) fn check_size(config: &CheckpointConfig, weights: &[u8]) -> Result<(), ModelError> {
    let parameters = SequenceModel::parameter_count(&config.model, config.context, config.horizon)?;
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

pub(crate) fn load_optimizer(
    spec: &OptimizerSpec,
    model: &SequenceModel,
    bytes: &[u8],
    steps: u64,
) -> Result<ModelOptimizer, ModelError> {
    let damaged = |reason| ModelError::CheckpointFile { file: OPTIMIZER_FILE, reason };
    let state = tensors::decode(OPTIMIZER_FILE, bytes)?;
    // Adam's bias correction raises its betas to this power, an `i32` in burn.
    let steps =
        i32::try_from(steps).ok().and_then(|steps| usize::try_from(steps).ok()).ok_or_else(
            || damaged(format!("step {steps} is beyond the {} that Adam counts", i32::MAX)),
        )?;
    ModelOptimizer::from_state(spec, model, state, steps).map_err(damaged)
}
