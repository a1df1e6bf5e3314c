//! Recordings beside the torques of an arm.

use spec::RobotDescription;

use super::channel::Channel;
use super::cuts::Cuts;
use super::layout::{self, Layout};
use super::limits::Farthest;
use super::rows::{self, States};
use crate::arm::Prior;
use crate::motion::Motion;

/// The findings about recordings, which are compared together.
pub struct Comparison {
    /// Length of the recordings and their longest period, s.
    pub seconds: f64,
    pub period_s: f64,
    pub layout: Layout,
    pub channels: Vec<Channel>,
    /// The levels at which each channel is cut off.
    pub cuts: Vec<Cuts>,
    pub ties: Ties,
    /// How far each joint goes towards its limits. Empty if no recording is long enough, and where
    /// limits were not asked for.
    pub farthest: Vec<Farthest>,
}

/// Mistakes that may be in columns of q as well as in those of u.
pub struct Ties {
    pub is_exchange_tied: bool,
    /// Joints with another sign.
    pub signs: Vec<usize>,
}

impl Comparison {
    /// Compares the torques of motions with those of an arm.
    pub fn of_torques(arm: &Prior, motions: &[Motion]) -> Self {
        let joints = arm.arm.joints();
        let states = States::new(motions, rows::MOST);
        let few = states.thinned(layout::ROWS);
        let mut layout = Layout::find(arm, &few);
        let is_exchange_tied = layout.settle_exchange(arm, &few);
        let mut ties = Ties { is_exchange_tied, signs: Vec::new() };
        let mut channels = Channel::all(arm, &states, &layout);
        let before = layout.clone();
        for joint in 0..joints {
            let is_turned =
                layout.has_declared_sign(joint) && channels[layout.torques[joint]].sign == Some(-1);
            if is_turned && layout.settle_sign(joint, arm, &few) {
                ties.signs.push(joint);
            }
        }
        if layout != before {
            channels = Channel::all(arm, &states, &layout);
        }
        Self {
            seconds: motions.iter().map(Motion::seconds).sum(),
            period_s: states.period_s(),
            layout,
            channels,
            cuts: Cuts::all(motions, joints),
            ties,
            farthest: Vec::new(),
        }
    }

    /// The same with the limits of a description.
    pub fn with_limits(self, description: &RobotDescription, motions: &[Motion]) -> Self {
        Self { farthest: Farthest::of(description, motions), ..self }
    }
}
