//! The errors of this crate.

use thiserror::Error;

/// An error in building, training, saving or loading a model, or in a prediction.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "messages say what variants and their fields mean")]
pub enum ModelError {
    #[error("the model cannot be built: {field} is {value}, allowed: {allowed}")]
    Size { field: &'static str, value: u64, allowed: String },

    #[error("{what} has {actual} values, expected {expected}")]
    Length { what: &'static str, actual: usize, expected: usize },

    #[error("the model was given {actual} {what}, expected {expected}")]
    Shape { what: &'static str, actual: usize, expected: usize },

    #[error("{what} of trajectory {trajectory} has a value that is not finite")]
    NotFiniteInput { what: &'static str, trajectory: usize },

    #[error("step {step}: the loss is {loss}, at a learning rate of {learning_rate}")]
    LossNotFinite { step: u64, loss: f64, learning_rate: f64 },

    #[error(
        "step {step}: the norm of the gradient is {gradient_norm}, at a loss of {loss} and a \
         learning rate of {learning_rate}"
    )]
    GradientNotFinite { step: u64, gradient_norm: f64, loss: f64, learning_rate: f64 },

    #[error("tensor `{tensor}` of {file} has {value}, expected finite values")]
    NotFiniteTensor { file: &'static str, tensor: String, value: f32 },

    #[error("interrupted")]
    Interrupted,

    #[error("normalization `dataset` needs the statistics of the training trajectories")]
    MissingStatistics,

    #[error(
        "a model trained with normalization `paper-leaky` needs the statistics of the horizon; use \
         `predict_with_leak`"
    )]
    LeakRequired,

    #[error("the model cannot be sampled: {field} is {value}, allowed: {allowed}")]
    Sampling { field: &'static str, value: String, allowed: String },

    #[error(
        "this model gives a single answer and no samples; use `predict`, or train a denoiser or a \
         model with a gaussian head"
    )]
    NotGenerative,

    #[error(transparent)]
    Spec(#[from] spec::SpecError),

    #[error(transparent)]
    Series(#[from] series::ShapeError),

    #[error("{file}: {reason}")]
    CheckpointFile { file: &'static str, reason: String },

    #[error(
        "{file} has format version {found}, this program reads {supported}; use a newer torqued"
    )]
    NewerCheckpoint { file: &'static str, found: u64, supported: u32 },

    #[error(
        "the checkpoint was written by a training with {field} {found}, this one has {expected}"
    )]
    OtherTraining { field: &'static str, found: String, expected: String },

    #[error("the tensor could not be read back from the device: {0}")]
    Device(String),
}

impl From<kernels::Interrupted> for ModelError {
    fn from(_: kernels::Interrupted) -> Self {
        Self::Interrupted
    }
}
