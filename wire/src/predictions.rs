//! Predictions of a checkpoint: a question and its answer.
//!
//! Positions are in rad, torques in N·m. A row has a value per joint.

use serde::{Deserialize, Serialize};
use spec::{Digest, SamplerSpec};
use utoipa::ToSchema;

use crate::Warning;

/// Scenarios to predict, and how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PredictionRequest {
    /// At least one scenario; they are answered in this order.
    pub scenarios: Vec<ObservedScenario>,
    #[serde(default)]
    pub sampling: PredictionSampling,
    /// Standard deviation of the noise of `y`, rad, 0 to 0.1: models that fit motions filter them by it.
    #[serde(default)]
    pub position_noise_rad: f64,
}

/// The motion of a robot so far, and the torques to come.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ObservedScenario {
    /// Torques of the context `[context][joint]`, N·m.
    pub u: Vec<Vec<f32>>,
    /// Joint positions of the context `[context][joint]`, rad.
    pub y: Vec<Vec<f32>>,
    /// Torques of the horizon `[horizon][joint]`, N·m.
    pub future_u: Vec<Vec<f32>>,
}

/// The form of the answer: one, or samples with their quantiles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PredictionSampling {
    /// The sampler of a model that removes noise; `null` is the checkpoint's.
    pub sampler: Option<SamplerSpec>,
    /// Samples per scenario, from a denoiser or a gaussian head; `y` is then their mean.
    /// `null` is one answer: the mean of a gaussian head, one sample of a denoiser.
    pub samples: Option<u32>,
    /// Quantiles to answer with, between 0 and 1, of at least 2 samples.
    pub quantiles: Vec<f64>,
    /// `true` adds the samples themselves to the answer.
    pub return_samples: bool,
    /// The key of all randomness, with the scenario's place in the request and the number of the
    /// sample.
    pub seed: u64,
}

/// The answer of a checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Prediction {
    #[serde(flatten)]
    pub model: PredictingModel,
    /// One answer for each scenario of the request, in their order.
    pub scenarios: Vec<PredictedScenario>,
    pub latency_ms: PredictionLatency,
    /// Data outside of what the checkpoint was trained on, contexts that tell nothing, predictions beyond the
    /// joints' limits.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// The model that answers, and the device that computes it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictingModel {
    pub checkpoint: i64,
    /// The digest of the training's spec.
    pub digest: Digest,
    /// The digest of the file of the weights.
    pub weights: Option<Digest>,
    pub rate_hz: f64,
    /// The name of the device, as `serve --device` takes it.
    #[schema(example = "cpu")]
    pub device: String,
    /// Threads that compute one prediction.
    pub threads: usize,
}

/// The answer to one scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictedScenario {
    /// Joint positions of the horizon `[horizon][joint]`, rad: the mean, if there are several
    /// samples.
    pub y: Vec<Vec<f32>>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub quantiles: Vec<PredictedQuantile>,
    /// `[samples][horizon][joint]`, rad, if they were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<Vec<Vec<Vec<f32>>>>,
}

/// A quantile of each position apart, over the samples, with linear interpolation between them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictedQuantile {
    pub quantile: f64,
    /// Joint positions `[horizon][joint]`, rad.
    pub y: Vec<Vec<f32>>,
}

/// The time of each part of the answer, ms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictionLatency {
    /// The time until the model was loaded; next to nothing when it was before.
    pub load: f64,
    /// The wait for the computation's turn.
    pub queue: f64,
    pub compute: f64,
}
