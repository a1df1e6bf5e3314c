//! The baseline that goes on as it moved.

use models::Interrupt;
use nalgebra::{Matrix3, Vector3};
use series::{Observed, Track};

use super::rollout::to_f32;
use crate::horizons::nearest_whole;
use crate::{EvaluationError, Predictor};

/// Starts at the last position of the context, and holds the velocity there.
///
/// The velocity is the slope, at its end, of the parabola that fits the last [`WINDOW_S`] of the
/// context best. The difference of the last two positions has the velocity of half a sample
/// earlier, and more of the encoder's noise.
#[derive(Clone, Copy, Debug)]
pub struct ConstantVelocity;

/// Recordings of a UR10e and a Panda at 60 Hz to 1 kHz: over the next 0.1 s, the error of 40 ms is
/// 2 to 16 % larger, and that of 150 ms is up to 3 % larger.
const WINDOW_S: f64 = 0.08;

/// A parabola has three coefficients.
const LEAST_SAMPLES: usize = 3;

impl Predictor for ConstantVelocity {
    fn name(&self) -> &'static str {
        "constant-velocity"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        let (horizon, joints) = (observed.horizon(), observed.joints());
        let period = 1.0 / observed.rate_hz();
        let mut predicted = Vec::with_capacity(observed.robots() * horizon * joints);
        let interrupt = Interrupt::current();
        for scenario in 0..observed.robots() {
            interrupt.leave_if_raised();
            let positions = observed.y(scenario);
            let last_sample = observed.context() - 1;
            let last = &positions[last_sample];
            let steps: Vec<f64> = (0..joints)
                .map(|joint| slope_at(positions, last_sample, joint, observed.rate_hz()) * period)
                .collect();
            for sample in 1..=horizon {
                let moved =
                    last.iter().zip(&steps).map(|(q, step)| f64::from(*q) + sample as f64 * step);
                predicted.extend(moved.map(to_f32));
            }
        }
        Ok(predicted)
    }
}

/// The velocity of `joint` at `sample`, rad/s: the slope of the parabola that fits the positions
/// within [`WINDOW_S`] on both sides best. With two positions it is their difference, and with one
/// it is 0.
pub(super) fn slope_at(positions: Track<'_>, sample: usize, joint: usize, rate_hz: f64) -> f64 {
    slope_among(positions, positions.samples(), sample, joint, rate_hz)
}

/// [`slope_at`] among the first `samples` positions.
pub(super) fn slope_among(
    positions: Track<'_>,
    samples: usize,
    sample: usize,
    joint: usize,
    rate_hz: f64,
) -> f64 {
    if samples < LEAST_SAMPLES {
        let mut ends = positions.joint(joint).map(f64::from);
        return ends.next().zip(ends.next()).map_or(0.0, |(first, last)| (last - first) * rate_hz);
    }
    let (mut curvature, mut moments) = (Matrix3::zeros(), Vector3::zeros());
    let at = f64::from(positions[sample][joint]);
    let reach = window(rate_hz) - 1;
    for other in (sample.saturating_sub(reach)..=(sample + reach).min(samples - 1)).rev() {
        // In units of the window, about −1 to 1, so that the equations are well conditioned.
        let time = (other as f64 - sample as f64) / (rate_hz * WINDOW_S);
        let powers = Vector3::new(1.0, time, time * time);
        curvature += powers * powers.transpose();
        moments += powers * (f64::from(positions[other][joint]) - at);
    }
    let fitted = curvature.cholesky().map(|curvature| curvature.solve(&moments));
    fitted.map_or(0.0, |fitted| fitted[1] / WINDOW_S)
}

/// Samples in [`WINDOW_S`], both ends included.
fn window(rate_hz: f64) -> usize {
    LEAST_SAMPLES.max(nearest_whole(rate_hz * WINDOW_S) + 1)
}

#[cfg(test)]
mod tests {
    use series::{Series, Shape};

    use super::*;
    use crate::baselines::fixture::first_order_robot;
    use crate::{HoldLast, rmse_deg};

    /// One robot with one joint, whose position is a function of time.
    fn moving(rate_hz: f64, samples: usize, q: impl Fn(f64) -> f64) -> Series {
        let shape = Shape { robots: 1, samples, joints: 1 };
        let y = (0..samples).map(|k| to_f32(q(k as f64 / rate_hz))).collect();
        Series::new(shape, rate_hz, vec![0.0; samples], y).unwrap()
    }

    #[test]
    fn it_goes_on_along_the_tangent_of_a_parabola() {
        for rate_hz in [10.0, 60.0, 1000.0] {
            let arm = moving(rate_hz, 130, |t| 0.3 + 0.5 * t - 2.0 * t * t);
            let predicted = ConstantVelocity.predict(&arm.observed(100)).unwrap();
            let end = 99.0 / rate_hz;
            let (position, velocity) = (0.3 + 0.5 * end - 2.0 * end * end, 0.5 - 4.0 * end);
            for (k, q) in (1..).zip(predicted) {
                let expected = position + velocity * f64::from(k) / rate_hz;
                assert!(
                    (f64::from(q) - expected).abs() < 1e-4 * (1.0 + expected.abs()),
                    "{rate_hz} Hz, {k}"
                );
            }
        }
    }

    #[test]
    fn few_positions_have_a_difference_and_one_has_no_velocity() {
        let arm = moving(60.0, 10, |t| 60.0 * t);
        for (context, next) in [(1, 0.0), (2, 2.0), (3, 3.0)] {
            let predicted = ConstantVelocity.predict(&arm.observed(context)).unwrap();
            assert!((predicted[0] - next).abs() < 1e-4, "{context}: {}", predicted[0]);
        }
    }

    #[test]
    fn it_predicts_a_smooth_motion_better_than_no_motion() {
        let robot = first_order_robot(0.8, 0.03);
        let near = robot.view().window(0..326);
        let error = |predictor: &dyn Predictor| {
            let predicted = predictor.predict(&near.observed(0, 320)).unwrap();
            rmse_deg(&near, 320, &predicted)[0]
        };
        let (moving, held) = (error(&ConstantVelocity), error(&HoldLast));
        assert!(moving < 0.3 * held, "{moving}° {held}°");
    }
}
