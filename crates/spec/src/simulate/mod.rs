//! Simulations: many randomized arms, each driven by its own excitation, open loop or by a
//! controller.

mod check;
mod columns;
mod completion;
mod control_law;
mod controller;
mod excitation;
mod excitation_columns;
mod following;
mod integrator;
mod kind;
mod observations;
mod references;
mod robot_spec;
mod spec;
mod speeds;

pub use columns::{Column, ColumnType};
pub(crate) use completion::{complete, complete_robot};
pub use control_law::{CartesianImpedance, ComputedTorque, ControlLaw, JointPd, OperationalSpace};
pub use controller::{Controller, MAX_DELAY_PERIODS};
pub use excitation::{
    Chirp, ChirpBand, Excitation, Family, Frequency, Multisine, PULSES, Pulses, STEP_LEVELS, Steps,
};
pub use integrator::{Integrator, Precision};
pub use observations::{MAX_POSITION_NOISE_RAD, Observations};
pub use references::{
    FourierSeries, HandPaths, MoveProfile, PathShape, PointToPointMoves, ViaPoints,
};
pub use robot_spec::{Friction, Gravity, Payload, RobotSpec};
pub use spec::{Cell, MAX_TRAJECTORIES, Rejection, SimulateSpec};
