//! The messages of a stream of predictions, each an object with one field: its name.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{PredictedScenario, PredictingModel, PredictionSampling, Problem, Warning};

/// A message to the server.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StreamMessage {
    /// The first message: how predictions are made. Sent again, it changes that.
    Open(StreamSettings),
    Step(StreamStep),
    /// Forgets the context and the previous prediction.
    Reset(Nothing),
}

/// The settings of the predictions that follow.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StreamSettings {
    pub sampling: PredictionSampling,
    /// Noise levels that a prediction which begins with the one before removes; `null` begins with
    /// noise every time.
    pub warm_start_steps: Option<u32>,
    /// Standard deviation of the noise of positions, rad, 0 to 0.1: models that fit motions filter them
    /// by it.
    pub position_noise_rad: f64,
}

/// Samples measured since the last message and, for a prediction, the torques that are planned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StreamStep {
    /// Torques `[new samples][joint]`, N·m.
    pub u: Vec<Vec<f32>>,
    /// Joint positions `[new samples][joint]`, rad.
    pub y: Vec<Vec<f32>>,
    /// Torques of the horizon `[horizon][joint]`, N·m.
    #[serde(default)]
    pub future_u: Option<Vec<Vec<f32>>>,
}

/// An object without fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Nothing {}

/// The server's answer to a message.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StreamReply {
    Opened(StreamOpened),
    Context(FilledContext),
    Prediction(StreamedPrediction),
    /// The message cannot be accepted and has changed nothing.
    Error(Problem),
}

/// The model that predicts, and what it needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StreamOpened {
    #[serde(flatten)]
    pub model: PredictingModel,
    #[serde(flatten)]
    pub filled: FilledContext,
    /// Samples of a prediction.
    pub horizon: usize,
}

/// Samples in the context, and how many there have to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FilledContext {
    pub filled: usize,
    pub context: usize,
}

/// A prediction on a stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StreamedPrediction {
    /// The number of the prediction, counted from 0.
    pub number: u64,
    #[serde(flatten)]
    pub predicted: PredictedScenario,
    /// Samples between the prediction that this one began with and this one; `null` if it began
    /// with noise.
    pub warm_start_shift: Option<usize>,
    pub latency_ms: StreamLatency,
    /// As of one question, each kind and joint once in a connection.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// The time of each part of the answer, ms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StreamLatency {
    /// The wait for the computation's turn.
    pub queue: f64,
    pub compute: f64,
    /// The time from the message to the answer, both as text.
    pub total: f64,
}
