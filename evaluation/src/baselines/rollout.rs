//! From laws of velocity to positions.

use spec::JOINTS;

use crate::Observed;

/// Mean velocity of a joint over each sampling period, in rad/s: one fewer than positions. That
/// over period k ends at sample k + 1 and is what torque k did.
pub(super) fn mean_velocities(
    positions: &[[f32; JOINTS]],
    joint: usize,
    period: f64,
) -> impl Iterator<Item = f64> {
    positions
        .windows(2)
        .map(move |pair| (f64::from(pair[1][joint]) - f64::from(pair[0][joint])) / period)
}

/// Integrates each joint's velocity law over the horizon, starting at the last context sample.
///
/// `law(scenario, joint)` gives the velocity over a period from the one before and the torque.
pub(super) fn rollout<Velocity: Fn(f64, f64) -> f64>(
    observed: &Observed,
    law: impl Fn(usize, usize) -> Velocity,
) -> Vec<f32> {
    let horizon = observed.horizon();
    let period = 1.0 / observed.rate_hz;
    let mut predicted = vec![0.0; observed.size * horizon * JOINTS];
    for scenario in 0..observed.size {
        let torques = observed.torques(scenario);
        let positions = observed.positions(scenario);
        for joint in 0..JOINTS {
            let velocity_of = law(scenario, joint);
            let last = observed.context - 1;
            let mut position = f64::from(positions[last][joint]);
            let mut velocity = mean_velocities(positions, joint, period).last().unwrap_or(0.0);
            for step in 0..horizon {
                velocity = velocity_of(velocity, f64::from(torques[last + step][joint]));
                position += velocity * period;
                predicted[(scenario * horizon + step) * JOINTS + joint] = to_f32(position);
            }
        }
    }
    predicted
}

#[expect(clippy::cast_possible_truncation, reason = "datasets hold f32")]
pub(crate) fn to_f32(value: f64) -> f32 {
    value as f32
}
