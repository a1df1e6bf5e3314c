//! Makes angles continuous that a controller wraps at ±π or at 2π.

use std::f64::consts::{PI, TAU};

use spec::Range;

/// The turns of one joint.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Turns {
    /// The position of the row before, with its turns.
    last: Option<f64>,
}

impl Turns {
    /// The angle with its full turns, rad. A step of more than half a turn is taken for the shorter
    /// way round. The first angle of a recording gets a turn only if it is within `range` with it,
    /// and not without.
    pub fn unwrap(&mut self, angle: f64, range: Range) -> f64 {
        let turned = match self.last {
            Some(last) if (angle - last).abs() <= PI => angle,
            Some(last) => angle - TAU * ((angle - last) / TAU).round(),
            None => {
                let turns = [0.0, -TAU, TAU];
                turns
                    .map(|turn| angle + turn)
                    .into_iter()
                    .find(|turned| range.contains(*turned))
                    .unwrap_or(angle)
            }
        };
        self.last = Some(turned);
        turned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unwrapped(angles: &[f64], range: Range) -> Vec<f64> {
        let mut turns = Turns::default();
        angles.iter().map(|angle| turns.unwrap(*angle, range)).collect()
    }

    fn check(angles: &[f64], range: Range, expected: &[f64]) {
        let found = unwrapped(angles, range);
        let is_equal =
            found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-12);
        assert!(is_equal && found.len() == expected.len(), "{found:?}");
    }

    #[test]
    fn an_angle_goes_on_across_every_wrap_in_both_directions() {
        let wide = Range::new(-100.0, 100.0);
        let motion: Vec<f64> = (0..200).map(|k| 2.0 + 14.0 * (f64::from(k) * 0.05).sin()).collect();
        let wrapped = |from: f64| {
            motion.iter().map(|angle| (angle - from).rem_euclid(TAU) + from).collect::<Vec<_>>()
        };
        check(&wrapped(-PI), wide, &motion);
        check(&wrapped(0.0), wide, &motion);
    }

    #[test]
    fn an_angle_that_does_not_wrap_keeps_its_bits() {
        let wide = Range::new(-6.5, 6.5);
        let angles = [0.1, 3.0, 3.3, 0.3, 2.9];
        assert_eq!(unwrapped(&angles, wide), angles);
    }

    /// A controller that counts from 0 to 2π, and a joint that moves between -2.9 and 2.9.
    #[test]
    fn the_first_angle_is_the_one_that_the_joint_can_have() {
        check(&[6.2, 6.1, 0.1], Range::new(-2.9, 2.9), &[6.2 - TAU, 6.1 - TAU, 0.1]);
        check(&[6.2, 6.1, 0.1], Range::new(-6.5, 6.5), &[6.2, 6.1, 0.1 + TAU]);
    }
}
