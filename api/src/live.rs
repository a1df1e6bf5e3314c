//! What computes predictions, as seen from here: plain arrays in and out.
//!
//! Nothing that computes models is compiled for this crate; whoever composes the server brings it.

use std::sync::Arc;
use std::time::Duration;

use futures::future::BoxFuture;
use series::Series;
use spec::{SamplerSpec, SpecError};
use store::{Checkpoint, StoreError};
use thiserror::Error;
use wire::Warning;

/// The models of checkpoints, kept loaded.
pub trait LiveModels: Send + Sync {
    /// The model of a checkpoint. It stays loaded at least as long as somebody holds it.
    fn load<'a>(
        &'a self,
        checkpoint: &'a Checkpoint,
    ) -> BoxFuture<'a, Result<Arc<dyn LiveModel>, LiveError>>;
}

/// A model that is loaded.
pub trait LiveModel: Send + Sync {
    fn about(&self) -> &AboutModel;

    /// Answers a question whose shapes are those of [`AboutModel`]. To drop the future is to give
    /// the computation up.
    fn predict(
        &self,
        question: Question,
        lane: Lane,
    ) -> BoxFuture<'static, Result<Answer, LiveError>>;
}

#[derive(Clone, Debug)]
pub struct AboutModel {
    /// Samples it is given.
    pub context: usize,
    /// Samples it predicts.
    pub horizon: usize,
    /// Joints of the arm.
    pub joints: usize,
    pub rate_hz: f64,
    /// Whether its normalization looks into the horizon, so that it cannot be asked.
    pub needs_future: bool,
    /// As `--device` takes it.
    pub device: String,
    /// That compute one prediction.
    pub threads: usize,
}

/// Who waits. Those of one lane wait for each other, one prediction after the other, and never for
/// those of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lane {
    Requests,
    Streams,
}

#[derive(Clone, Debug)]
pub struct Question {
    /// Torques of context and horizon, positions of the context.
    pub scenarios: Series,
    /// How many answers to each, of a model that has several; `None` is the one it would give if
    /// asked for one.
    pub samples: Option<usize>,
    /// `None` is the checkpoint's.
    pub sampler: Option<SamplerSpec>,
    pub seed: u64,
    pub previous: Option<Previous>,
}

/// An earlier prediction to begin with instead of noise.
#[derive(Clone, Debug)]
pub struct Previous {
    /// Joint positions `[size, horizon, 7]`, rad.
    pub positions: Vec<f32>,
    /// Samples between that prediction and this one.
    pub shift: usize,
    /// Noise levels that are removed again.
    pub steps: u32,
}

#[derive(Clone, Debug)]
pub struct Answer {
    /// Joint positions `[samples, size, horizon, 7]`, rad; all finite.
    pub positions: Vec<f32>,
    pub samples: usize,
    /// Doubts about the question and the answer.
    pub warnings: Vec<Warning>,
    /// Until its turn came.
    pub queued: Duration,
    pub computed: Duration,
}

/// Why there is no prediction.
#[derive(Debug, Error)]
pub enum LiveError {
    /// What the model of this checkpoint cannot do.
    #[error("{0}")]
    Refused(SpecError),

    #[error("{waiting} predictions are waiting to be computed, as many as may; try again later")]
    Queue { waiting: usize },

    #[error(
        "the models in use fill the {models} places or {bytes} bytes that there are for loaded \
         models; try again later"
    )]
    Full { models: usize, bytes: u64 },

    #[error("the model has {found} bytes; loaded models may have {bytes} together")]
    TooLarge { found: u64, bytes: u64 },

    #[error("the model cannot be loaded: {reason}")]
    Unusable { reason: String },

    #[error("the model failed: {reason}")]
    Failed { reason: String },

    #[error("reading the checkpoint failed")]
    Store(#[from] StoreError),
}
