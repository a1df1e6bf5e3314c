//! Closed loop: how well a robot follows a path when a predictor plans its torques.
//!
//! A [`Plant`] is a simulated robot that was excited for a while. A [`Controller`] has a
//! [`Forecast`]. [`Experiment::run`] lets it plan by [`mppi`], applies the first torques of the
//! plan, observes the robot, and plans again. In the simulation planning takes no time. The actual
//! time is recorded.

mod figure;
mod forecast;
mod mppi;
mod plant;
mod reference;
mod summary;
mod trial;

pub use figure::{robot_figure, tracking_figure};
pub use forecast::{Controller, Forecast, Foreseen, Now, Simulated};
pub use plant::Plant;
pub use reference::Reference;
pub use summary::summarize;
pub use trial::{Experiment, RobotTrials, Trace, Tracking, Trial};
