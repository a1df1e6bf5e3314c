//! The spec of a simulation, and its division into shards and cells.

use std::ops::Range as IndexRange;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::controller::Controller;
use super::excitation::{Excitation, Family};
use super::integrator::{Integrator, Precision};
use super::observations::Observations;
use super::robot_spec::RobotSpec;
use crate::{Execution, InitialState};

/// The largest possible dataset: trajectories are numbered in 32 bits. A server's own limit is
/// lower.
pub const MAX_TRAJECTORIES: u64 = 2_147_483_647;

/// Simulates `trajectories` arms, each with its own parameters, initial state and excitation.
///
/// Trajectory `i` depends only on the spec and `i`, and never on shards, workers or threads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulateSpec {
    /// Number of trajectories; each is one robot. A server accepts 1 to 10 000 000 by default.
    pub trajectories: u64,
    /// Seed of every random draw, 0 to 2^53 - 1.
    #[serde(default)]
    pub seed: u64,
    /// Number of samples per trajectory (the paper's N).
    #[serde(default = "defaults::samples")]
    pub samples: u32,
    /// Sampling rate in Hz; the torque is held over each period.
    #[serde(default = "defaults::rate_hz")]
    pub rate_hz: f64,
    /// The torques, or the references of the controller.
    pub excitation: Excitation,
    /// The controller that makes the arm follow references. `null` for torques that are applied
    /// open loop.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub controller: Option<Box<Controller>>,
    /// The arm, and how robots differ from it.
    #[serde(default)]
    pub robot: RobotSpec,
    /// How each arm's positions and velocities at the beginning are drawn.
    #[serde(default)]
    pub initial_state: InitialState,
    /// Additional recorded quantities, besides torques and joint positions.
    #[serde(default)]
    pub observations: Observations,
    /// When a trajectory is drawn again.
    #[serde(default)]
    pub rejection: Rejection,
    /// How each sampling period is integrated.
    #[serde(default)]
    pub integrator: Integrator,
    /// The numbers that the simulation computes with.
    #[serde(default)]
    pub precision: Precision,
    /// Number of trajectories per shard. A shard is one task and one Parquet file.
    #[serde(default = "defaults::shard_trajectories")]
    pub shard_trajectories: u32,
    /// How the job is executed. It is not part of the digest.
    #[serde(default, skip_serializing_if = "Execution::is_default")]
    pub execution: Execution,
}

/// When a trajectory is drawn again. (The paper's code keeps only runs that keep away from the
/// joint limits.)
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Rejection {
    /// Draws again if any joint comes within this distance of a limit, rad; `null` keeps all
    /// trajectories.
    pub position_margin_rad: Option<f64>,
    /// Number of draws per trajectory before the simulation fails.
    pub max_draws: u32,
}

impl Default for Rejection {
    fn default() -> Self {
        Self { position_margin_rad: Some(0.01), max_draws: 1000 }
    }
}

/// One excitation family at one frequency, and its trajectories.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Cell {
    /// The excitation family.
    pub family: Family,
    /// The master frequency, Hz.
    pub frequency_hz: f64,
    /// Index of the first trajectory.
    pub first: u64,
    /// Number of trajectories.
    pub count: u64,
}

impl SimulateSpec {
    /// Number of joints of the robot.
    pub fn joints(&self) -> usize {
        self.robot.joints()
    }

    /// Number of shards, which is also the number of tasks.
    pub fn shard_count(&self) -> u64 {
        self.trajectories.div_ceil(u64::from(self.shard_trajectories))
    }

    /// About how many bytes the files of the dataset have. 14 numbers took 43 bytes per sample, measured
    /// on the paper's training sets with trajectories of 400 samples.
    pub fn estimated_bytes(&self) -> u64 {
        const BYTES: u64 = 43;
        const NUMBERS: u64 = 14;

        // The columns `trajectory` and `step` take next to nothing.
        let numbers = (self.trajectory_columns().len() as u64).saturating_sub(2);
        let samples = self.trajectories.saturating_mul(u64::from(self.samples));
        samples.saturating_mul(numbers * BYTES) / NUMBERS
    }

    /// The trajectories of shard `index`.
    pub fn shard(&self, index: u64) -> IndexRange<u64> {
        let first = index * u64::from(self.shard_trajectories);
        first..(first + u64::from(self.shard_trajectories)).min(self.trajectories)
    }

    /// The cells of a grid, in order. Empty if the frequency is not a grid.
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
