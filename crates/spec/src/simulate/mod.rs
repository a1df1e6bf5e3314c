//! Simulations: many randomized arms, each driven by its own excitation, open loop or by a
//! controller.

mod check;
mod columns;
mod completion;
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
pub use controller::{ComputedTorque, ControlLaw, Controller, JointPd, MAX_DELAY_PERIODS};
pub use excitation::{
    Chirp, ChirpBand, Excitation, Family, Frequency, Multisine, STEP_LEVELS, Steps,
};
pub use following::Doubt;
pub use integrator::{Integrator, Precision};
pub use observations::{MAX_POSITION_NOISE_RAD, Observations};
pub use references::{FourierSeries, MoveProfile, PointToPointMoves, ViaPoints};
pub use robot_spec::{Friction, Gravity, Payload, RobotSpec};
pub use spec::{Cell, MAX_TRAJECTORIES, Rejection, SimulateSpec};
