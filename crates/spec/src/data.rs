//! Trajectories by the spec that makes them, whether simulated or recorded.

use crate::{Cell, Column, ImportSpec, Observations, Range, RobotSpec, SimulateSpec};

/// The highest rate of trajectories, Hz.
pub const MAX_SAMPLING_RATE_HZ: f64 = 1000.0;

/// The spec that makes trajectories, of a dataset or a stream.
#[derive(Clone, Debug, PartialEq)]
pub enum DataSpec {
    /// Simulated arms.
    Simulation(SimulateSpec),
    /// A file of recordings.
    Import(ImportSpec),
}

impl DataSpec {
    /// Columns of the table with one row per time step.
    pub fn trajectory_columns(&self) -> Vec<Column> {
        match self {
            Self::Simulation(spec) => spec.trajectory_columns(),
            Self::Import(spec) => spec.trajectory_columns(),
        }
    }

    /// Columns of the table with one row per trajectory.
    pub fn table_columns(&self) -> Vec<Column> {
        match self {
            Self::Simulation(spec) => spec.robot_columns(),
            Self::Import(spec) => spec.table_columns(),
        }
    }

    /// Number of joints, which is the number of channels of u and of y.
    pub fn joints(&self) -> usize {
        match self {
            Self::Simulation(spec) => spec.joints(),
            Self::Import(spec) => spec.joints(),
        }
    }

    /// Position limits of each joint, rad, from the robot's description. An import that names no
    /// robot has the limits of the default robot.
    pub fn limits_rad(&self) -> Vec<Range> {
        let limits = |robot: &RobotSpec| robot.description().per_joint(|joint| joint.position_rad);
        match self {
            Self::Simulation(spec) => limits(&spec.robot),
            Self::Import(spec) => limits(&spec.robot()),
        }
    }

    /// Rated torque of each joint, N·m, from the same description.
    pub fn limits_nm(&self) -> Vec<f64> {
        let limits = |robot: &RobotSpec| robot.description().per_joint(|joint| joint.torque_nm);
        match self {
            Self::Simulation(spec) => limits(&spec.robot),
            Self::Import(spec) => limits(&spec.robot()),
        }
    }

    /// Number of samples per trajectory.
    pub fn samples(&self) -> u32 {
        match self {
            Self::Simulation(spec) => spec.samples,
            Self::Import(spec) => spec.samples,
        }
    }

    /// Samples per second.
    pub fn rate_hz(&self) -> f64 {
        match self {
            Self::Simulation(spec) => spec.rate_hz,
            Self::Import(spec) => spec.rate_hz,
        }
    }

    /// Number of trajectories; `None` for an import, because only its result tells.
    pub fn trajectories(&self) -> Option<u64> {
        match self {
            Self::Simulation(spec) => Some(spec.trajectories),
            Self::Import(_) => None,
        }
    }

    /// Number of shards of the dataset, which is also its number of tasks.
    pub fn shard_count(&self) -> u64 {
        match self {
            Self::Simulation(spec) => spec.shard_count(),
            Self::Import(_) => 1,
        }
    }

    /// The cells of a simulation's frequency grid, in order. Empty without a grid.
    pub fn cells(&self) -> Vec<Cell> {
        self.simulation().map(SimulateSpec::cells).unwrap_or_default()
    }

    /// Whether there are references of a controller. Recordings have none.
    pub fn has_references(&self) -> bool {
        self.simulation().is_some_and(|spec| spec.controller.is_some())
    }

    /// Standard deviation of the error of a measured position, rad. For an import it is what the
    /// spec states.
    pub fn position_deviation_rad(&self) -> f64 {
        match self {
            Self::Simulation(spec) => spec.observations.position_deviation_rad(),
            Self::Import(spec) => spec.position_noise_rad,
        }
    }

    /// Standard deviation of the noise of measured torques, N·m. An import has only the torques
    /// that its file has.
    pub fn torque_noise_nm(&self) -> f64 {
        self.simulation().map(|spec| spec.observations.torque_noise_nm).unwrap_or_default()
    }

    /// The columns of measured values beside true ones, and other additional columns. An import has
    /// none: its values are the measured ones.
    pub fn observations(&self) -> Observations {
        self.simulation().map(|spec| spec.observations).unwrap_or_default()
    }

    /// The simulation; `None` for an import.
    pub fn simulation(&self) -> Option<&SimulateSpec> {
        match self {
            Self::Simulation(spec) => Some(spec),
            Self::Import(_) => None,
        }
    }
}
