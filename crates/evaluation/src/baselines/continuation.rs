//! The motion of an arm after its context, by simulation.

use dynamics::{Anchor, Joints, Motion, Replay, Robot, mass_matrix};
use series::Track;
use spec::RobotSpec;

use super::NominalArm;
use super::constant_velocity::slope_at;
use super::end_state::EndState;
use crate::horizons::nearest_whole;

/// Time between two measured positions to which a simulation is set, s.
pub(super) const STRETCH_S: f64 = 1.0 / 3.0;

/// Simulates arms from the end of their context.
#[derive(Clone, Debug)]
pub(super) struct Continuation {
    pub replay: Replay,
    /// Whether the nominal arm forgets velocities within [`STRETCH_S`].
    pub forgets: bool,
}

impl Continuation {
    pub fn new(arm: &NominalArm) -> Self {
        Self { replay: arm.replay(), forgets: forgets_velocities(&arm.robot) }
    }

    /// Positions `[horizon, joint]`, rad, that `robot` takes after the context's `positions` under
    /// `torques` `[sample, joint]` of context and horizon, N·m. `None` if one is not finite.
    ///
    /// It starts in the state `end`. Without one it starts at the last position, with the slope of the
    /// positions there. An arm that forgets velocities has the velocity that the torques of the last
    /// [`STRETCH_S`] give it.
    pub fn simulate(
        &self,
        robot: &Robot,
        torques: &[f32],
        positions: Track<'_>,
        end: Option<EndState>,
    ) -> Option<Vec<f32>> {
        let (joints, rate_hz) = (robot.joints(), self.replay.rate_hz);
        let last = positions.samples() - 1;
        let first = last.saturating_sub(whole(rate_hz * STRETCH_S));
        let position = |sample: usize| -> Joints<f64> {
            positions[sample].iter().copied().map(f64::from).collect()
        };
        let velocity = |sample: usize| {
            Joints::from_fn(joints, |joint| slope_at(positions, sample, joint, rate_hz))
        };
        let (q, qd) = match end {
            Some(end) => (end.q, Some(end.qd)),
            None => (position(last), (!self.forgets).then(|| velocity(last))),
        };
        let anchors = [Anchor { sample: last - first, q, qd }];
        let (q0, qd0) = (position(first), velocity(first));
        let motion = Motion { robot, q0, qd0, u: &torques[first * joints..], anchors: &anchors };
        let simulated = self.replay.run(&[motion]);
        let horizon = &simulated[(last + 1 - first) * joints..];
        horizon.iter().all(|q| q.is_finite()).then(|| horizon.to_vec())
    }
}

/// Whether every joint of the nominal arm loses at least two fifths of a velocity, 1 − e^-0.5, to its
/// damping within a stretch.
pub(super) fn forgets_velocities(robot: &RobotSpec) -> bool {
    let arm = Robot::nominal(robot);
    let center = robot.description().initial_state.center_rad.as_slice();
    let inertia = mass_matrix(&arm, center);
    (0..arm.joints()).all(|joint| arm.damping[joint] * STRETCH_S > 0.5 * inertia[joint][joint])
}

/// The nearest whole number of samples, at least one.
pub(super) fn whole(samples: f64) -> usize {
    nearest_whole(samples).max(1)
}
