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
    /// The spectra of torques and positions, first their means over the joints.
    pub spectra: Vec<SpectrumSummary>,
    /// The arms of a simulation: statistics over its trajectories of some columns of the table of robots. Empty for
    /// recordings.
    #[serde(default)]
    pub arms: Vec<ChannelSummary>,
}

/// A parameter of simulated arms that summaries show.
#[derive(Clone, Copy, Debug)]
pub struct ArmParameter {
    /// Its column in the table of robots. A column for each joint has `_` and the joint's number after it.
    pub column: &'static str,
    /// Its name for people.
    pub title: &'static str,
}

/// The parameters of simulated arms that summaries show, in the order of their tables.
pub const ARM_PARAMETERS: [ArmParameter; 7] = [
    ArmParameter { column: "mass", title: "link mass" },
    ArmParameter { column: "damping", title: "viscous friction" },
    ArmParameter { column: "friction_phi1", title: "friction φ1" },
    ArmParameter { column: "armature", title: "rotor inertia" },
    ArmParameter { column: "payload_mass", title: "payload" },
    ArmParameter { column: "gravity_m_s2", title: "gravity" },
    ArmParameter { column: "frequency_hz", title: "frequency of the excitation" },
];

impl ArmParameter {
    /// The parameter of a column, and the joint or link that the column is about, from 1; `None` for other columns.
    pub fn of(column: &str) -> Option<(Self, Option<usize>)> {
        ARM_PARAMETERS.into_iter().find_map(|parameter| {
            match column.strip_prefix(parameter.column)? {
                "" => Some((parameter, None)),
                joint => Some((parameter, Some(joint.strip_prefix('_')?.parse().ok()?))),
            }
        })
    }
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

/// Mean one-sided power spectral density: of all joints and some trajectories of each shard, or of one joint and some
/// trajectories of the first shard. Means are removed, and a Hann window is used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SpectrumSummary {
    /// `u` or `q`.
    #[schema(example = "q")]
    pub signal: String,
    /// The joint, from 1. `null` for the mean over all joints.
    #[serde(default)]
    pub joint: Option<u32>,
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
