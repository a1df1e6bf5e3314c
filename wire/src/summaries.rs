//! The contents of a dataset in a few numbers.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Counts, ranges and spectra over the shards that are finished.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Summary {
    pub dataset: i64,
    /// Trajectories in the shards that are finished.
    pub trajectories: u64,
    /// Index of the first of them.
    pub first: u64,
    /// Samples of all those trajectories together.
    pub samples: u64,
    /// Draws refused on the way to those trajectories.
    pub rejected: u64,
    /// Trajectories that channels and spectra tell of: all, unless another version of torqued made
    /// them.
    pub summarized: u64,
    pub channels: Vec<ChannelSummary>,
    pub spectra: Vec<SpectrumSummary>,
}

/// All samples of a channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ChannelSummary {
    #[schema(example = "q1")]
    pub name: String,
    #[schema(example = "rad")]
    pub unit: Option<String>,
    pub about: Option<String>,
    pub min: f64,
    pub max: f64,
    pub mean: f64,
    /// Standard deviation.
    pub std: f64,
}

/// Mean one-sided power spectral density over all joints and some trajectories of each shard, with
/// means removed and a Hann window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SpectrumSummary {
    /// `u` or `q`.
    #[schema(example = "q")]
    pub signal: String,
    #[schema(example = "rad²/Hz")]
    pub unit: String,
    /// Trajectories that it is the mean of.
    pub trajectories: u64,
    /// Distance of the bands; the first is at 0 Hz.
    pub step_hz: f64,
    /// A value per band, in `unit`.
    #[schema(value_type = Vec<f64>)]
    pub density: Vec<f32>,
}
