//! Robots as data: what an arm is made of, how it may move, and by which laws it is drawn.

mod built_in;
mod check;
mod description;
mod initial_state;

pub use built_in::{BuiltInRobot, RobotModel};
pub use description::{
    AttachedBody, BodyDescription, HandDescription, InertiaScheme, JointDescription, JointFriction,
    MAX_JOINTS, Randomization, RobotDescription,
};
pub use initial_state::InitialState;
