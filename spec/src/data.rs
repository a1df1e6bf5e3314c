use crate::{Cell, Column, ImportSpec, Observations, Range, RobotSpec, SimulateSpec};

/// What makes trajectories: the spec behind a dataset or a stream.
#[expect(clippy::large_enum_variant, reason = "few exist at a time")]
#[derive(Clone, Debug, PartialEq)]
pub enum DataSpec {
    Simulation(SimulateSpec),
    Import(ImportSpec),
}

impl DataSpec {
    /// Of the table with a row per time step.
    pub fn trajectory_columns(&self) -> Vec<Column> {
        match self {
            Self::Simulation(spec) => spec.trajectory_columns(),
            Self::Import(spec) => spec.trajectory_columns(),
        }
    }

    /// Of the table with a row per trajectory.
    pub fn table_columns(&self) -> Vec<Column> {
        match self {
            Self::Simulation(spec) => spec.robot_columns(),
            Self::Import(spec) => spec.table_columns(),
        }
    }

    /// Joints of the robot: channels of u, and of y.
    pub fn joints(&self) -> usize {
        match self {
            Self::Simulation(spec) => spec.joints(),
            Self::Import(spec) => spec.joints(),
        }
    }

    /// Limits of each joint's position, rad, from the robot's description. A recording whose import names no
    /// robot has those of the default one.
    pub fn limits_rad(&self) -> Vec<Range> {
        let limits = |robot: &RobotSpec| robot.description().per_joint(|joint| joint.position_rad);
        match self {
            Self::Simulation(spec) => limits(&spec.robot),
            Self::Import(spec) => limits(&spec.robot()),
        }
    }

    /// Rated torque of each joint, N·m, of the same robot.
    pub fn limits_nm(&self) -> Vec<f64> {
        let limits = |robot: &RobotSpec| robot.description().per_joint(|joint| joint.torque_nm);
        match self {
            Self::Simulation(spec) => limits(&spec.robot),
            Self::Import(spec) => limits(&spec.robot()),
        }
    }

    /// Samples per trajectory.
    pub fn samples(&self) -> u32 {
        match self {
            Self::Simulation(spec) => spec.samples,
            Self::Import(spec) => spec.samples,
        }
    }

    pub fn rate_hz(&self) -> f64 {
        match self {
            Self::Simulation(spec) => spec.rate_hz,
            Self::Import(spec) => spec.rate_hz,
        }
    }

    /// `None` for an import, of which only its result tells.
    pub fn trajectories(&self) -> Option<u64> {
        match self {
            Self::Simulation(spec) => Some(spec.trajectories),
            Self::Import(_) => None,
        }
    }

    /// Shards, and so tasks, of the dataset.
    pub fn shard_count(&self) -> u64 {
        match self {
            Self::Simulation(spec) => spec.shard_count(),
            Self::Import(_) => 1,
        }
    }

    /// The cells of a simulation's frequency grid, in order; none without one.
    pub fn cells(&self) -> Vec<Cell> {
        self.simulation().map(SimulateSpec::cells).unwrap_or_default()
    }

    /// Columns beside torques and positions, and the noise of measurements; of an import nothing is known.
    pub fn observations(&self) -> Observations {
        self.simulation().map(|spec| spec.observations).unwrap_or_default()
    }

    pub fn simulation(&self) -> Option<&SimulateSpec> {
        match self {
            Self::Simulation(spec) => Some(spec),
            Self::Import(_) => None,
        }
    }
}
