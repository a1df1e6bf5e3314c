//! The interface to live predictions, with plain arrays.
//!
//! The code that computes models is not compiled into this crate. The server's composition passes
//! it in.

use std::sync::Arc;
use std::time::Duration;

use futures::future::BoxFuture;
use series::Series;
use spec::{SamplerSpec, SpecError};
use store::{Checkpoint, StoreError};
use thiserror::Error;
use wire::Warning;

/// The models of checkpoints, which stay loaded.
pub trait LiveModels: Send + Sync {
    /// The model of a checkpoint. It stays loaded at least as long as somebody holds it.
    fn load<'a>(
        &'a self,
        checkpoint: &'a Checkpoint,
    ) -> BoxFuture<'a, Result<Arc<dyn LiveModel>, LiveError>>;
}

/// A loaded model.
pub trait LiveModel: Send + Sync {
    fn about(&self) -> &AboutModel;

    /// Predicts for a request with the shapes in [`AboutModel`]. Dropping the future cancels the
    /// computation.
    fn predict(
        &self,
        question: Question,
        queue: LiveQueue,
    ) -> BoxFuture<'static, Result<LivePrediction, LiveError>>;
}

#[derive(Clone, Debug)]
pub struct AboutModel {
    /// Number of samples of its context.
    pub context: usize,
    /// Number of samples of its horizon.
    pub horizon: usize,
    /// Number of joints of the arm.
    pub joints: usize,
    pub rate_hz: f64,
    /// Whether its normalization looks into the horizon, so it cannot predict live.
    pub needs_future: bool,
    /// The device's name, as in `--device`.
    pub device: String,
    /// Number of threads that compute one prediction.
    pub threads: usize,
}

/// A queue of predictions. Those of one queue are computed one after the other, and never wait for
/// those of the other queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LiveQueue {
    Requests,
    Streams,
}

#[derive(Clone, Debug)]
pub struct Question {
    /// Torques of context and horizon, and positions of the context.
    pub scenarios: Series,
    /// Number of samples per scenario, from a model that can give several. `None` for one
    /// prediction.
    pub samples: Option<usize>,
    /// `None` for the checkpoint's own sampler.
    pub sampler: Option<SamplerSpec>,
    pub seed: u64,
    pub previous: Option<Previous>,
}

/// An earlier prediction to start from, instead of noise.
#[derive(Clone, Debug)]
pub struct Previous {
    /// Joint positions `[scenarios, horizon, joints]`, rad.
    pub positions: Vec<f32>,
    /// Number of samples from that prediction to this one.
    pub shift: usize,
    /// Number of noise levels that are removed again.
    pub steps: u32,
}

#[derive(Clone, Debug)]
pub struct LivePrediction {
    /// Joint positions `[samples, scenarios, horizon, joints]`, rad; all finite.
    pub positions: Vec<f32>,
    pub samples: usize,
    /// Warnings about the request and the prediction.
    pub warnings: Vec<Warning>,
    /// Time until its turn came.
    pub queued: Duration,
    pub computed: Duration,
}

/// Why there is no prediction.
#[derive(Debug, Error)]
pub enum LiveError {
    /// The model of this checkpoint cannot do this.
    #[error("{0}")]
    Refused(SpecError),

    #[error("{waiting} predictions are waiting, which is the limit; try again later")]
    Queue { waiting: usize },

    #[error("questions to models take all of {bytes} bytes of memory; try again later")]
    Memory { bytes: usize },

    #[error(
        "there is no room for another model: the models in use take all {models} places or {bytes} \
         bytes; try again later"
    )]
    Full { models: usize, bytes: u64 },

    #[error("the model has {found} bytes, allowed: {bytes} for all loaded models together")]
    TooLarge { found: u64, bytes: u64 },

    #[error("the model cannot be loaded: {reason}")]
    Unusable { reason: String },

    #[error("the model failed: {reason}")]
    Failed { reason: String },

    #[error("reading the checkpoint failed")]
    Store(#[from] StoreError),
}
