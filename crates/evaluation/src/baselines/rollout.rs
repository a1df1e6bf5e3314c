//! Converts between positions and mean velocities.

use models::Interrupt;
use series::{Observed, Track};

/// Mean velocity of a joint over each sampling period, in rad/s. There is one period fewer than
/// positions. Period k ends at sample k + 1 and shows the effect of torque k.
pub(super) fn mean_velocities(
    positions: Track<'_>,
    joint: usize,
    period: f64,
) -> impl Iterator<Item = f64> {
    let pairs = positions.joint(joint).zip(positions.joint(joint).skip(1));
    pairs.map(move |(before, after)| (f64::from(after) - f64::from(before)) / period)
}

/// Integrates each joint's velocity law over the horizon, starting at the last sample of the
/// context.
///
/// `law(scenario, joint)` gives the velocity over a period from the velocity before and the torque.
pub(super) fn rollout<Velocity: Fn(f64, f64) -> f64>(
    observed: &Observed<'_>,
    law: impl Fn(usize, usize) -> Velocity,
) -> Vec<f32> {
    let horizon = observed.horizon();
    let period = 1.0 / observed.rate_hz();
    let joints = observed.joints();
    let mut predicted = vec![0.0; observed.robots() * horizon * joints];
    let interrupt = Interrupt::current();
    for scenario in 0..observed.robots() {
        interrupt.leave_if_raised();
        let torques = observed.u(scenario);
        let positions = observed.y(scenario);
        for joint in 0..joints {
            let velocity_of = law(scenario, joint);
            let last = observed.context() - 1;
            let mut position = f64::from(positions[last][joint]);
            let mut velocity = mean_velocities(positions, joint, period).last().unwrap_or(0.0);
            for step in 0..horizon {
                velocity = velocity_of(velocity, f64::from(torques[last + step][joint]));
                position += velocity * period;
                predicted[(scenario * horizon + step) * joints + joint] = to_f32(position);
            }
        }
    }
    predicted
}

#[expect(clippy::cast_possible_truncation, reason = "datasets hold f32")]
pub(crate) fn to_f32(value: f64) -> f32 {
    value as f32
}
