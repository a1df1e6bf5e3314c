//! How far predictions lie beyond the limits of joints.

use models::POSITION_ROUNDING_RAD;
use spec::Range;

/// A rollout with an error above this has diverged, degrees. After half a turn, a joint's position
/// says nothing about the arm.
pub const DIVERGED_DEG: f64 = 180.0;

/// The largest distance of the positions `[horizon, joint]` of each joint beyond its limits,
/// degrees. It is 0 within the limits, and infinite where a position is NaN.
pub fn beyond_limits_deg(positions: &[f32], limits_rad: &[Range]) -> Vec<f64> {
    let of_joint = |(joint, limits): (usize, &Range)| {
        let of_joint = positions.iter().skip(joint).step_by(limits_rad.len());
        let beyond = of_joint.map(|&q| match f64::from(q) {
            q if q.is_nan() => f64::INFINITY,
            q => match (limits.min - q).max(q - limits.max) {
                beyond if beyond > POSITION_ROUNDING_RAD => beyond.to_degrees(),
                _ => 0.0,
            },
        });
        beyond.fold(0.0, f64::max)
    };
    limits_rad.iter().enumerate().map(of_joint).collect()
}

/// Whether a rollout has a value that is not finite, or an error above [`DIVERGED_DEG`].
pub fn has_diverged(truth: &[f32], predicted: &[f32]) -> bool {
    let errors = truth.iter().zip(predicted);
    // In this form NaN counts as diverged.
    !errors
        .map(|(q, predicted)| (f64::from(*predicted) - f64::from(*q)).abs().to_degrees())
        .all(|error| error <= DIVERGED_DEG)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_beyond_a_limit_is_told_joint_by_joint() {
        let limits = [Range::new(-1.0, 1.0), Range::new(0.0, 2.0)];
        let found = beyond_limits_deg(&[0.5, -0.1, 1.5, 1.0], &limits);
        assert!((found[0] - 0.5_f64.to_degrees()).abs() < 1e-5, "{found:?}");
        assert!((found[1] - 0.1_f64.to_degrees()).abs() < 1e-5, "{found:?}");
        assert_eq!(beyond_limits_deg(&[1.0, 2.0], &limits), [0.0, 0.0]);
        let at_the_limit = [Range::new(-2.8973, 2.8973)];
        assert_eq!(beyond_limits_deg(&[2.8973, -2.8973], &at_the_limit), [0.0]);
        assert_eq!(beyond_limits_deg(&[f32::NAN, 1.0], &limits), [f64::INFINITY, 0.0]);
    }

    #[test]
    fn half_a_turn_off_or_not_finite_has_diverged() {
        assert!(!has_diverged(&[0.0, 0.0], &[3.1, -3.1]));
        for value in [3.2, -3.2, f32::NAN, f32::INFINITY] {
            assert!(has_diverged(&[0.0, 0.0], &[0.0, value]), "{value}");
        }
    }
}
