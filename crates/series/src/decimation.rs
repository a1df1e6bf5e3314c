//! Questions at a lower rate: the mean of every few samples, for models of a lower rate than the
//! recording's.

use std::ops::Range;

use crate::{MeasurementNoise, Observed, Series, Shape, ShapeError, Track};

/// Knots of the polynomial between two predicted positions.
const KNOTS: usize = 4;
/// Knots of the context that the polynomial may use.
const KEPT: usize = 2;

/// A question at a lower rate.
///
/// The context is cut into blocks of `factor` samples that end with it. A block's position is the
/// mean of its samples, less the share of the curvature that a mean adds. It stands at the middle
/// of the block, a *knot*. A torque is the mean between two knots. So noise that is independent from
/// sample to sample shrinks by the root of `factor`, nothing is delayed, and torques keep their
/// impulse.
#[derive(Debug)]
pub struct Decimated {
    series: Series,
    factor: usize,
    context: usize,
    /// Samples of the horizon at the higher rate.
    horizon: usize,
    /// The last positions of the context of each robot, `[robot, KEPT, joint]`, rad.
    kept: Vec<f32>,
}

impl Decimated {
    /// `observed` with the means of `factor` samples. `None` if its context has no two blocks.
    ///
    /// # Errors
    /// [`ShapeError::TooLarge`].
    pub fn new(observed: &Observed<'_>, factor: usize) -> Result<Option<Self>, ShapeError> {
        let context = observed.context() / factor.max(1);
        if factor < 2 || context < KEPT {
            return Ok(None);
        }
        let (joints, horizon) = (observed.joints(), observed.horizon());
        // The last knot of the context is (factor + 1) / 2 samples before the horizon's first one,
        // and the last knot of the horizon not before its last one.
        let ahead = (2 * horizon + factor - 1).div_ceil(2 * factor);
        let shape = Shape { robots: observed.robots(), samples: context + ahead, joints };
        let first = observed.context() - context * factor;
        let (mut u, mut y) = (Vec::new(), Vec::new());
        for robot in 0..observed.robots() {
            y.extend(positions(observed.y(robot), first, factor, joints));
            u.extend(torques(observed.u(robot), first, factor, shape.samples, joints));
        }
        let kept = y
            .chunks_exact(context * joints)
            .flat_map(|robot| robot[(context - KEPT) * joints..].iter().copied())
            .collect();
        let root = (factor as f64).sqrt();
        let MeasurementNoise { position_rad, torque_nm } = observed.noise();
        let noise =
            MeasurementNoise { position_rad: position_rad / root, torque_nm: torque_nm / root };
        let rate_hz = observed.rate_hz() / factor as f64;
        let series = Series::question(shape, context, rate_hz, u, y)?.with_noise(noise);
        Ok(Some(Self { series, factor, context, horizon, kept }))
    }

    /// The question.
    pub fn observed(&self) -> Observed<'_> {
        self.series.observed(self.context)
    }

    /// Positions at the higher rate, `[answer, horizon, joint]`, from those at the knots. Answers
    /// have the robots in turn. Between knots they follow the polynomial through the four nearest
    /// ones.
    pub fn restored(&self, answers: &[f32]) -> Vec<f32> {
        let Shape { robots, samples, joints } = self.series.shape();
        let ahead = samples - self.context;
        let mut restored = Vec::with_capacity(answers.len() * self.factor);
        for (index, answer) in answers.chunks_exact(ahead * joints).enumerate() {
            let kept = &self.kept[index % robots * KEPT * joints..][..KEPT * joints];
            let knots: Vec<f32> = kept.iter().chain(answer).copied().collect();
            for sample in 0..self.horizon {
                let (used, weights) = self.weights(sample, KEPT + ahead);
                restored.extend((0..joints).map(|joint| {
                    let at = used.clone().map(|knot| f64::from(knots[knot * joints + joint]));
                    let weighted = at.zip(&weights).map(|(value, weight)| value * weight);
                    narrow(weighted.sum())
                }));
            }
        }
        restored
    }

    /// The knots that a sample of the horizon is interpolated from, and their weights (Lagrange).
    fn weights(&self, sample: usize, knots: usize) -> (Range<usize>, Vec<f64>) {
        let factor = self.factor as f64;
        // In knots, from the first one kept.
        let at = (KEPT - 1) as f64 + (sample as f64 + 0.5 * (factor + 1.0)) / factor;
        let count = KNOTS.min(knots);
        let first = whole(at).saturating_sub(KNOTS / 2 - 1).min(knots - count);
        let used = first..first + count;
        let weight = |knot: usize| {
            let others = used.clone().filter(|&other| other != knot);
            let ratios = others.map(|other| (at - other as f64) / (knot as f64 - other as f64));
            ratios.product()
        };
        let weights = used.clone().map(weight).collect();
        (used, weights)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "recorded values are f32")]
fn narrow(value: f64) -> f32 {
    value as f32
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a place among the knots, which is not negative"
)]
fn whole(place: f64) -> usize {
    place.floor() as usize
}

/// The position at each knot, `[knot, joint]`.
fn positions(y: Track<'_>, first: usize, factor: usize, joints: usize) -> Vec<f32> {
    let blocks = y.values()[first * joints..].chunks_exact(factor * joints);
    let means: Vec<Vec<f64>> = blocks
        .map(|block| {
            let of_joint = |joint: usize| {
                let values = block.iter().skip(joint).step_by(joints);
                values.map(|&value| f64::from(value)).sum::<f64>() / factor as f64
            };
            (0..joints).map(of_joint).collect()
        })
        .collect();
    // The mean of a parabola over a block exceeds its middle by this share of the second difference.
    let excess = (1.0 - (factor as f64).powi(-2)) / 24.0;
    let last = means.len() - 1;
    let value = |(knot, mean): (usize, &Vec<f64>)| -> Vec<f32> {
        let middle = knot.clamp(1, last.saturating_sub(1).max(1));
        let curvature = |joint: usize| match means.get(middle + 1) {
            Some(after) => after[joint] - 2.0 * means[middle][joint] + means[middle - 1][joint],
            None => 0.0,
        };
        let of_joint = |(joint, mean): (usize, &f64)| narrow(mean - excess * curvature(joint));
        mean.iter().enumerate().map(of_joint).collect()
    };
    means.iter().enumerate().flat_map(value).collect()
}

/// The mean torque from each of `knots` knots to the next, `[knot, joint]`. The last torque is held.
fn torques(u: Track<'_>, first: usize, factor: usize, knots: usize, joints: usize) -> Vec<f32> {
    let last = u.samples() - 1;
    let mean = |knot: usize, joint: usize| {
        // A knot is in the middle of a period, or between two if the factor is odd.
        let twice = 2 * (first + knot * factor) + factor - 1;
        let value = |sample: usize| f64::from(u[sample.min(last)][joint]);
        let begin = twice / 2;
        let mut sum: f64 = (begin..begin + factor).map(value).sum();
        if twice % 2 == 1 {
            sum += 0.5 * (value(begin + factor) - value(begin));
        }
        narrow(sum / factor as f64)
    };
    (0..knots).flat_map(|knot| (0..joints).map(move |joint| mean(knot, joint))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A motion under a torque of two joints: q = sin t and t³ / 10, and u their second derivatives
    /// as means until the next sample.
    fn recording(samples: usize, rate_hz: f64) -> (Vec<f32>, Vec<f32>) {
        let (mut u, mut y) = (Vec::new(), Vec::new());
        let speed = |t: f64| [t.cos(), 0.3 * t * t];
        for sample in 0..samples {
            let [now, next] = [sample, sample + 1].map(|sample| sample as f64 / rate_hz);
            y.extend([now.sin(), 0.1 * now.powi(3)].map(narrow));
            let [before, after] = [speed(now), speed(next)];
            u.extend((0..2).map(|joint| narrow((after[joint] - before[joint]) * rate_hz)));
        }
        (u, y)
    }

    fn asked(factor: usize, context: usize, samples: usize) -> (Series, Decimated) {
        let (u, y) = recording(samples, 1000.0);
        let shape = Shape { robots: 1, samples, joints: 2 };
        let noise = MeasurementNoise { position_rad: 1e-4, torque_nm: 0.2 };
        let series = Series::new(shape, 1000.0, u, y).unwrap().with_noise(noise);
        let decimated = Decimated::new(&series.observed(context), factor).unwrap().unwrap();
        (series, decimated)
    }

    #[test]
    fn knots_have_the_positions_of_their_time_and_the_impulse_between_them() {
        for (factor, context, samples) in [(16, 500, 700), (5, 503, 640), (2, 100, 101)] {
            let (_, decimated) = asked(factor, context, samples);
            let observed = decimated.observed();
            assert_eq!(observed.context(), context / factor);
            assert!((observed.rate_hz() * factor as f64 - 1000.0).abs() < 1e-9);
            assert!((observed.noise().position_rad * (factor as f64).sqrt() - 1e-4).abs() < 1e-12);
            let first = context % factor;
            let time = |knot: usize| {
                (first as f64 + (knot * factor) as f64 + 0.5 * (factor as f64 - 1.0)) / 1000.0
            };
            let (u, y) = (observed.u(0), observed.y(0));
            for knot in 0..observed.context() {
                let [now, next] = [time(knot), time(knot + 1)];
                assert!((f64::from(y[knot][0]) - now.sin()).abs() < 1e-6, "{factor} {knot}");
                assert!((f64::from(y[knot][1]) - 0.1 * now.powi(3)).abs() < 1e-6);
                let mean = (next.cos() - now.cos()) / (next - now);
                assert!((f64::from(u[knot][0]) - mean).abs() < 1e-3, "{factor} {knot}");
            }
        }
    }

    #[test]
    fn the_true_positions_at_the_knots_give_back_the_horizon() {
        for (factor, context, samples) in [(16, 500, 700), (5, 503, 640), (8, 80, 81), (3, 7, 9)] {
            let (series, decimated) = asked(factor, context, samples);
            let observed = decimated.observed();
            let first = context % factor;
            let ahead = observed.context()..observed.samples();
            let answer: Vec<f32> = ahead
                .flat_map(|knot| {
                    let sample = (first + knot * factor) as f64 + 0.5 * (factor as f64 - 1.0);
                    let time = sample / 1000.0;
                    [time.sin(), 0.1 * time.powi(3)].map(narrow)
                })
                .collect();
            let restored = decimated.restored(&answer);
            let expected = &series.y()[context * 2..];
            assert_eq!(restored.len(), expected.len());
            for (found, expected) in restored.iter().zip(expected) {
                assert!((found - expected).abs() < 2e-6, "{factor}: {found} {expected}");
            }
        }
    }

    #[test]
    fn a_context_without_two_blocks_has_no_lower_rate() {
        let (u, y) = recording(20, 1000.0);
        let series =
            Series::new(Shape { robots: 1, samples: 20, joints: 2 }, 1000.0, u, y).unwrap();
        assert!(Decimated::new(&series.observed(9), 5).unwrap().is_none());
        assert!(Decimated::new(&series.observed(9), 1).unwrap().is_none());
        assert!(Decimated::new(&series.observed(10), 5).unwrap().is_some());
    }
}
