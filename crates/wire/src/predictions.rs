//! Predictions with a checkpoint: requests and answers.
//!
//! Positions are in rad, torques in N·m. A row has a value per joint.

use serde::{Deserialize, Serialize};
use spec::{Digest, SamplerSpec};
use utoipa::ToSchema;

use crate::Warning;

/// Scenarios to predict, and options.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PredictionRequest {
    /// At least one scenario. The answers have the same order. A scenario with `futures` has one
    /// answer for each of them.
    pub scenarios: Vec<ObservedScenario>,
    /// Whether to answer with one prediction or with samples.
    #[serde(default)]
    pub sampling: PredictionSampling,
    /// Standard deviation of the noise of `y`, rad, 0 to 0.1. Models that fit motions use it to
    /// filter `y`.
    #[serde(default)]
    pub position_noise_rad: f64,
    /// Samples per second of `u`, `y` and the answer; the checkpoint's own if left out. A
    /// `lagrangian` also answers at whole multiples of it. Context and horizon then have as many
    /// times the rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
}

/// The motion of a robot so far, and the planned torques.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ObservedScenario {
    /// Torques of the context `[context][joint]`, N·m.
    pub u: Vec<Vec<f32>>,
    /// Joint positions of the context `[context][joint]`, rad.
    pub y: Vec<Vec<f32>>,
    /// Torques of the horizon `[horizon][joint]`, N·m. Left out if there are `futures`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub future_u: Vec<Vec<f32>>,
    /// In place of `future_u`: several possible torques of the horizon `[future][horizon][joint]`,
    /// N·m, which share this context.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub futures: Vec<Vec<Vec<f32>>>,
}

impl ObservedScenario {
    /// The possible torques of the horizon, one list of rows for each answer.
    pub fn possible_futures(&self) -> &[Vec<Vec<f32>>] {
        if self.futures.is_empty() { std::slice::from_ref(&self.future_u) } else { &self.futures }
    }
}

/// Options of the answer: one prediction, or samples with their quantiles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PredictionSampling {
    /// The sampler of a denoiser; `null` for the checkpoint's own.
    pub sampler: Option<SamplerSpec>,
    /// Samples per scenario, from a denoiser or a gaussian head. `y` is then their mean. `null`
    /// gives one prediction: the mean of a gaussian head, or one sample of a denoiser.
    pub samples: Option<u32>,
    /// Quantiles to return, between 0 and 1. They need at least 2 samples.
    pub quantiles: Vec<f64>,
    /// `true` also returns the samples themselves.
    pub return_samples: bool,
    /// The seed of all random numbers, together with the index of the answer and the sample's
    /// number.
    pub seed: u64,
}

/// The prediction of a checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Prediction {
    /// The model and its device.
    #[serde(flatten)]
    pub model: PredictingModel,
    /// One prediction for each scenario of the request, or for each of its futures, in the same
    /// order.
    pub scenarios: Vec<PredictedScenario>,
    /// How long the parts of the answer took.
    pub latency_ms: PredictionLatency,
    /// Data outside the checkpoint's training data, contexts without information, and predictions
    /// beyond the joints' limits.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// Motions whose torques are asked for: the inverse question.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TorqueRequest {
    /// At least one scenario. The answers have the same order.
    pub scenarios: Vec<MovedScenario>,
    /// In place of every `u` and `y`: the `fit` of an earlier answer, whose robots are asked again, in the
    /// same order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<Digest>,
    /// Standard deviation of the noise of `y`, rad, 0 to 0.1. The model filters `y` with it.
    #[serde(default)]
    pub position_noise_rad: f64,
    /// Samples per second of `u` and `y`: the checkpoint's own, which is the default, or a whole
    /// multiple of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
}

/// The motion of a robot so far, and a motion that it should make.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MovedScenario {
    /// Torques of the context `[context][joint]`, N·m. Left out with `fit`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub u: Vec<Vec<f32>>,
    /// Joint positions of the context `[context][joint]`, rad. Left out with `fit`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub y: Vec<Vec<f32>>,
    /// The motion whose torques are asked for.
    pub motion: WantedMotion,
}

/// A motion at some instants, at most 1000. Instants need not follow each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WantedMotion {
    /// Positions `[instant][joint]`, rad.
    pub q: Vec<Vec<f32>>,
    /// Velocities `[instant][joint]`, rad/s.
    pub qd: Vec<Vec<f32>>,
    /// Accelerations `[instant][joint]`, rad/s².
    pub qdd: Vec<Vec<f32>>,
}

/// The torques that motions take.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TorqueAnswer {
    /// The model and its device.
    #[serde(flatten)]
    pub model: PredictingModel,
    /// The fitted robots, for further questions without their contexts.
    pub fit: Digest,
    /// One answer for each scenario of the request, in the same order.
    pub scenarios: Vec<SaidTorques>,
    /// How long the parts of the answer took.
    pub latency_ms: PredictionLatency,
    /// Data outside the checkpoint's training data, contexts without information, and motions or
    /// torques beyond the limits of the arm that a law is told.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// The torques of a motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SaidTorques {
    /// Torques `[instant][joint]`, N·m, of the robot that explains the context best.
    pub u: Vec<Vec<f32>>,
}

/// The model that predicts, and the device that computes it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictingModel {
    /// The id of the checkpoint.
    pub checkpoint: i64,
    /// The digest of the training's spec.
    pub digest: Digest,
    /// The digest of the weights file.
    pub weights: Option<Digest>,
    /// Samples per second of the context and of the prediction.
    pub rate_hz: f64,
    /// The name of the device, as `serve --device` takes it.
    #[schema(example = "cpu")]
    pub device: String,
    /// Number of threads that compute one prediction.
    pub threads: usize,
}

/// The prediction for one scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictedScenario {
    /// Joint positions of the horizon `[horizon][joint]`, rad. With several samples, their mean.
    pub y: Vec<Vec<f32>>,
    /// The quantiles that the request asks for, in its order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub quantiles: Vec<PredictedQuantile>,
    /// `[samples][horizon][joint]`, rad, if the request asks for them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<Vec<Vec<Vec<f32>>>>,
}

/// A quantile of each position by itself, with linear interpolation between samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictedQuantile {
    /// The probability, between 0 and 1.
    pub quantile: f64,
    /// Joint positions `[horizon][joint]`, rad.
    pub y: Vec<Vec<f32>>,
}

/// The duration of each part of the answer, ms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictionLatency {
    /// Waiting for the model to be loaded; close to 0 if it was loaded before.
    pub load: f64,
    /// Waiting in the queue for the computation.
    pub queue: f64,
    /// The computation itself.
    pub compute: f64,
}
