//! Simulations: many randomized arms, each driven by its own excitation.

mod check;
mod columns;
mod completion;
mod excitation;
mod following;
mod integrator;
mod kind;
mod observations;
mod robot_spec;
mod spec;
mod speeds;

pub use columns::{Column, ColumnType};
pub(crate) use completion::{complete, complete_robot};
pub use excitation::{
    Chirp, ChirpBand, Excitation, Family, Frequency, Multisine, STEP_LEVELS, Steps,
};
pub use following::Doubt;
pub use integrator::{Integrator, Precision};
pub use observations::{MAX_POSITION_NOISE_RAD, Observations};
pub use robot_spec::{Friction, Gravity, Payload, RobotSpec};
pub use spec::{Cell, MAX_TRAJECTORIES, Rejection, SimulateSpec};
