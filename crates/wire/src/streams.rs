//! The messages of a prediction stream. Each is an object with one field, which names the message.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{
    PredictedScenario, PredictingModel, PredictionSampling, Problem, SaidTorques, WantedMotion,
    Warning,
};

/// A message to the server.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StreamMessage {
    /// The first message: the settings of predictions. A later `open` changes them.
    Open(StreamSettings),
    /// New samples, with or without a request for a prediction.
    Step(StreamStep),
    /// Fits a robot to the context, for the following questions for torques.
    Fit(Nothing),
    /// A motion whose torques are asked for.
    Motion(WantedMotion),
    /// Forgets the context, the previous prediction and the fitted robot.
    Reset(Nothing),
}

/// The settings of the following predictions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StreamSettings {
    /// Whether to answer with one prediction or with samples.
    pub sampling: PredictionSampling,
    /// Number of noise levels that a prediction removes when it starts from the one before. `null`
    /// starts from noise every time.
    pub warm_start_steps: Option<u32>,
    /// Standard deviation of the noise of positions, rad, 0 to 0.1. Models that fit motions filter
    /// them accordingly.
    pub position_noise_rad: f64,
    /// Samples per second of the stream and its predictions; `null` for the checkpoint's own. A
    /// `lagrangian` also answers at whole multiples of it. Another rate than before empties the
    /// context.
    pub rate_hz: Option<f64>,
}

/// Samples measured since the last message and, to request a prediction, the planned torques.
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
    /// The answer to `open`.
    Opened(StreamOpened),
    /// The answer to `reset`, and to a `step` without planned torques or before the context is
    /// full.
    Context(FilledContext),
    /// The answer to a `step` with planned torques.
    Prediction(StreamedPrediction),
    /// The answer to `fit`.
    Fitted(StreamFitted),
    /// The answer to `motion`.
    Torques(StreamedTorques),
    /// The message was refused and has changed nothing.
    Error(Problem),
}

/// The model that predicts, and the data that it needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StreamOpened {
    /// The model and its device.
    #[serde(flatten)]
    pub model: PredictingModel,
    /// How full the context is.
    #[serde(flatten)]
    pub filled: FilledContext,
    /// Number of samples of a prediction.
    pub horizon: usize,
}

/// Number of samples in the context, and number of samples that are needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FilledContext {
    /// Number of samples in the context.
    pub filled: usize,
    /// Number of samples that a prediction needs.
    pub context: usize,
}

/// A robot was fitted to the context.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StreamFitted {
    /// How long the parts of the fit took.
    pub latency_ms: StreamLatency,
    /// Like the warnings of a prediction, but each kind and joint appears once per connection.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// The torques of a motion on a stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StreamedTorques {
    /// Torques `[instant][joint]`, N·m, of the robot that was fitted last.
    #[serde(flatten)]
    pub said: SaidTorques,
    /// Number of samples since the robot was fitted.
    pub age: usize,
    /// Time from the message to the answer, ms.
    pub latency_ms: f64,
    /// Positions, velocities and torques beyond the limits of the arm that a law is told. Each answer
    /// has all of its own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// A prediction on a stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StreamedPrediction {
    /// The number of the prediction, counting from 0.
    pub number: u64,
    /// The predicted positions, their quantiles and samples.
    #[serde(flatten)]
    pub predicted: PredictedScenario,
    /// Number of samples from the prediction that this one started from; `null` if it started from
    /// noise.
    pub warm_start_shift: Option<usize>,
    /// How long the parts of the answer took.
    pub latency_ms: StreamLatency,
    /// Like the warnings of a single prediction, but each kind and joint appears once per
    /// connection.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// The duration of each part of the answer, ms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StreamLatency {
    /// Waiting in the queue for the computation.
    pub queue: f64,
    /// The computation itself.
    pub compute: f64,
    /// Time from the message to the answer, both as text.
    pub total: f64,
}
