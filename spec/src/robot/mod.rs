//! Robots as data: what an arm is made of, how it may move, and by which laws it is drawn.

mod built_in;
mod check;
mod defaults;
mod description;

pub use built_in::{BuiltInRobot, RobotModel};
pub(crate) use defaults::complete;
pub use description::{
    AttachedBody, BodyDescription, HandDescription, JointDescription, JointFriction, Randomization,
    RobotDescription,
};

/// The most joints that a robot may have.
pub const MAX_JOINTS: usize = 8;
