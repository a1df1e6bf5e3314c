//! Closed loop: how well a robot follows a path when a predictor plans its torques, or adds torques to
//! those of the robot's own controller ([`Pursuit`]).
//!
//! A [`Plant`] is a simulated robot that was excited for a while. A [`Controller`] predicts with a
//! [`Forecast`]. [`Experiment::run`] repeats four steps: the controller plans by [`mppi`], the
//! first torques of the plan are applied, the robot moves, and the controller observes it. In the
//! simulation planning takes no time. The actual time is recorded.

mod feed_forward;
mod figure;
mod forecast;
mod mppi;
mod plant;
mod reference;
mod summary;
mod tracking;
mod trial;

pub use feed_forward::{ExpectedTorques, FeedForward, Pursued, Pursuit, SayTorques};
pub use figure::{robot_figure, tracking_figure};
pub use forecast::{Controller, Forecast, Foreseen, Now, Simulated};
pub use plant::Plant;
pub use reference::Reference;
pub use summary::summarize;
pub use tracking::Tracking;
pub use trial::{Experiment, Ran, RobotTrials, Trace, Trial};
