use std::ops::Range as IndexRange;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::excitation::{Excitation, Family};
use super::integrator::{Integrator, Precision};
use super::observations::Observations;
use super::robot_spec::RobotSpec;
use crate::{Execution, InitialState};

/// The largest dataset there can be: trajectories are numbered in 32 bits. A server's own limit is
/// lower.
pub const MAX_TRAJECTORIES: u64 = 2_147_483_647;

/// Simulate `trajectories` arms, each with its own parameters, initial state and excitation.
///
/// Trajectory `i` depends on (spec, `i`) alone: never on shards, workers or threads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulateSpec {
    /// Number of trajectories; each is one robot. A server takes 1 to 10 000 000 unless told otherwise.
    pub trajectories: u64,
    /// Key of every random draw, 0 to 2^53 - 1.
    #[serde(default)]
    pub seed: u64,
    /// Samples per trajectory (the paper's N).
    #[serde(default = "defaults::samples")]
    pub samples: u32,
    /// Sampling rate in Hz; the torque is held over each period.
    #[serde(default = "defaults::rate_hz")]
    pub rate_hz: f64,
    pub excitation: Excitation,
    #[serde(default)]
    pub robot: RobotSpec,
    #[serde(default)]
    pub initial_state: InitialState,
    /// What is recorded besides torques and joint positions.
    #[serde(default)]
    pub observations: Observations,
    #[serde(default)]
    pub rejection: Rejection,
    #[serde(default)]
    pub integrator: Integrator,
    #[serde(default)]
    pub precision: Precision,
    /// Trajectories per shard, that is, per task and per Parquet file.
    #[serde(default = "defaults::shard_trajectories")]
    pub shard_trajectories: u32,
    #[serde(default, skip_serializing_if = "Execution::is_default")]
    pub execution: Execution,
}

/// Which trajectories are drawn again (source: the paper's code keeps only runs that stay clear
/// of the joint limits).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Rejection {
    /// Draw again when any joint comes within this distance of a limit, in rad; `null` keeps all.
    pub position_margin_rad: Option<f64>,
    /// Draws per trajectory before the simulation fails.
    pub max_draws: u32,
}

impl Default for Rejection {
    fn default() -> Self {
        Self { position_margin_rad: Some(0.01), max_draws: 1000 }
    }
}

/// One excitation family at one frequency, and the trajectories that have it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Cell {
    pub family: Family,
    pub frequency_hz: f64,
    /// Index of the first trajectory.
    pub first: u64,
    /// Number of trajectories.
    pub count: u64,
}

impl SimulateSpec {
    /// Joints of the robot.
    pub fn joints(&self) -> usize {
        self.robot.joints()
    }

    pub fn shard_count(&self) -> u64 {
        self.trajectories.div_ceil(u64::from(self.shard_trajectories))
    }

    /// The trajectories of shard `index`.
    pub fn shard(&self, index: u64) -> IndexRange<u64> {
        let first = index * u64::from(self.shard_trajectories);
        first..(first + u64::from(self.shard_trajectories)).min(self.trajectories)
    }

    /// The cells of a grid, in order; empty when the frequency is not a grid.
    ///
    /// Trajectories are divided among grid frequencies in contiguous blocks of equal size.
    pub fn cells(&self) -> Vec<Cell> {
        let grid = self.excitation.grid();
        let count = self.trajectories / (grid.len() as u64).max(1);
        (0u64..)
            .zip(grid)
            .map(|(k, (family, frequency_hz))| Cell {
                family,
                frequency_hz,
                first: k * count,
                count,
            })
            .collect()
    }
}

mod defaults {
    pub const fn samples() -> u32 {
        400
    }
    pub const fn rate_hz() -> f64 {
        60.0
    }
    pub const fn shard_trajectories() -> u32 {
        10_000
    }
}
