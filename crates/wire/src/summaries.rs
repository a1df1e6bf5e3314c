//! The summary of a dataset in a few numbers.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Counts, ranges and spectra over the finished shards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Summary {
    /// The id of the dataset.
    pub dataset: i64,
    /// Number of trajectories in the finished shards.
    pub trajectories: u64,
    /// Index of the first trajectory.
    pub first: u64,
    /// Number of samples of all those trajectories together.
    pub samples: u64,
    /// Number of draws refused while making those trajectories.
    pub rejected: u64,
    /// Number of trajectories that channels and spectra cover: all, unless another version of
    /// torqued made some of them.
    pub summarized: u64,
    /// The channels, in the order of the table's columns.
    pub channels: Vec<ChannelSummary>,
    /// The spectra of torques and positions.
    pub spectra: Vec<SpectrumSummary>,
}

/// Statistics of all samples of a channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ChannelSummary {
    /// The name of the table's column.
    #[schema(example = "q1")]
    pub name: String,
    /// The unit of its values. `null` without one.
    #[schema(example = "rad")]
    pub unit: Option<String>,
    /// Its meaning. `null` if only the dataset's author knows it.
    pub about: Option<String>,
    /// The smallest value.
    pub min: f64,
    /// The largest value.
    pub max: f64,
    /// The mean value.
    pub mean: f64,
    /// Standard deviation.
    pub std: f64,
}

/// Mean one-sided power spectral density over all joints and some trajectories of each shard. Means
/// are removed, and a Hann window is used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SpectrumSummary {
    /// `u` or `q`.
    #[schema(example = "q")]
    pub signal: String,
    /// The unit of the density.
    #[schema(example = "rad²/Hz")]
    pub unit: String,
    /// Number of trajectories in the mean.
    pub trajectories: u64,
    /// Distance between frequencies. The first is 0 Hz.
    pub step_hz: f64,
    /// One value per frequency, in `unit`.
    #[schema(value_type = Vec<f64>)]
    pub density: Vec<f32>,
}
