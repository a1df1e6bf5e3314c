//! Robots as data: the parts of an arm, its limits, and the laws of its randomization.

mod built_in;
pub(crate) mod check;
mod description;
mod initial_state;
mod reference;

pub use built_in::{BuiltInRobot, RobotModel};
pub use description::{
    AttachedBody, BaseDescription, BodyDescription, HandDescription, InertiaScheme,
    JointDescription, JointFriction, MAX_JOINTS, Randomization, RobotDescription,
};
pub use initial_state::InitialState;
pub use reference::{MAX_ROBOT_REFERENCES, NamedRobot, RobotReference, named_robots};
pub(crate) use reference::{allowed_for_misnamed, refuse_named_robots};
