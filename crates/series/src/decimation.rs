//! Questions at a lower rate, for models of a lower rate than the recording's.

use std::ops::Range;

use crate::{MeasurementNoise, Observed, Series, Shape, ShapeError, Track};

/// Knots of the polynomial between two predicted positions.
const KNOTS: usize = 4;

/// A question at a lower rate.
///
/// Every `factor`-th sample, counted back from the last one of the context and on from there, is a
/// *knot*. A knot's position is the mean of the samples nearest to it, less what their curvature adds.
/// At either end of a context, samples lie on one side, and a line through them gives the position
/// instead, whose noise is larger. A torque is the mean from one knot to the next. So noise that is
/// independent from sample to sample shrinks by the root of `factor`, nothing is delayed, and torques
/// keep their impulse.
#[derive(Debug)]
pub struct Decimated {
    series: Series,
    factor: usize,
    context: usize,
    /// Samples of the horizon at the higher rate.
    horizon: usize,
}

impl Decimated {
    /// Knots of the context with which answers begin. The polynomial uses them.
    pub const BEHIND: usize = 2;

    /// `observed` with the means of `factor` samples. `None` if its context has no two knots.
    ///
    /// # Errors
    /// [`ShapeError::TooLarge`].
    pub fn new(observed: &Observed<'_>, factor: usize) -> Result<Option<Self>, ShapeError> {
        let context = match observed.context().checked_sub(1) {
            Some(before) if factor >= 2 => 1 + before / factor,
            _ => 0,
        };
        if context < Self::BEHIND {
            return Ok(None);
        }
        let (joints, horizon) = (observed.joints(), observed.horizon());
        let ahead = horizon.div_ceil(factor);
        let shape = Shape { robots: observed.robots(), samples: context + ahead, joints };
        let first = (observed.context() - 1) % factor;
        let (mut u, mut y) = (Vec::new(), Vec::new());
        for robot in 0..observed.robots() {
            y.extend(positions(observed.y(robot), first, factor));
            u.extend(torques(observed.u(robot), first, factor, shape.samples));
        }
        let root = (factor as f64).sqrt();
        let MeasurementNoise { position_rad, torque_nm, last_position_rad } = observed.noise();
        let noise = MeasurementNoise {
            position_rad: position_rad / root,
            torque_nm: torque_nm / root,
            last_position_rad: last_position_rad * noise_at_end(factor, context),
        };
        let rate_hz = observed.rate_hz() / factor as f64;
        let series = Series::question(shape, context, rate_hz, u, y)?.with_noise(noise);
        Ok(Some(Self { series, factor, context, horizon }))
    }

    /// The question.
    pub fn observed(&self) -> Observed<'_> {
        self.series.observed(self.context)
    }

    /// Positions at the higher rate, `[answer, horizon, joint]`, from those at the knots, of which
    /// [`Decimated::BEHIND`] are of the context. Between knots they follow the polynomial through the
    /// four nearest ones.
    pub fn restored(&self, answers: &[f32]) -> Vec<f32> {
        let Shape { samples, joints, .. } = self.series.shape();
        let count = Self::BEHIND + samples - self.context;
        let mut restored = Vec::with_capacity(answers.len() * self.factor);
        for knots in answers.chunks_exact(count * joints) {
            for sample in 0..self.horizon {
                let (used, weights) = self.weights(sample, count);
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
        let at = (Self::BEHIND - 1) as f64 + (sample + 1) as f64 / factor;
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

/// The samples that a position is taken from.
struct Window {
    /// Samples before the knot.
    before: usize,
    /// The weight of each sample. They add up to 1, and a slope adds nothing.
    weights: Vec<f64>,
    /// The weighted mean exceeds the position by this share of the second difference of knots.
    excess: f64,
}

impl Window {
    /// The mean of `factor` samples around a knot. If they are even in number, the outermost two
    /// count half.
    fn around(factor: usize) -> Self {
        let before = factor / 2;
        let mut weights = vec![1.0; 2 * before + 1];
        if factor.is_multiple_of(2) {
            weights[0] = 0.5;
            weights[2 * before] = 0.5;
        }
        weights.iter_mut().for_each(|weight| *weight /= factor as f64);
        Self::new(before, weights, factor)
    }

    /// The line through the samples from the knot to the next one, by least squares, at the knot.
    fn after(factor: usize) -> Self {
        let samples = (factor + 1) as f64;
        let weight = |offset: usize| {
            (4.0 * samples - 2.0 - 6.0 * offset as f64) / (samples * (samples + 1.0))
        };
        Self::new(0, (0..=factor).map(weight).collect(), factor)
    }

    /// The same with the samples from the knot before.
    fn before(factor: usize) -> Self {
        let Self { mut weights, excess, .. } = Self::after(factor);
        weights.reverse();
        Self { before: factor, weights, excess }
    }

    fn new(before: usize, weights: Vec<f64>, factor: usize) -> Self {
        let each = weights.iter().enumerate();
        let offset = |place: usize| (place as f64 - before as f64) / factor as f64;
        let excess = each.map(|(place, weight)| 0.5 * weight * offset(place).powi(2)).sum();
        Self { before, weights, excess }
    }
}

/// The noise of the last position of a context with so many knots, where a sample's is 1.
fn noise_at_end(factor: usize, knots: usize) -> f64 {
    let [middle, end] = [Window::around(factor), Window::before(factor)];
    // The last window, and in the curvature the two before it.
    let shares = match knots {
        0..3 => [1.0, 0.0, 0.0],
        _ => {
            // A window at the beginning of the context makes no difference worth counting.
            let curvature = end.excess / (1.0 + end.excess - middle.excess);
            [1.0 - curvature, 2.0 * curvature, -curvature]
        }
    };
    let mut weights = vec![0.0; 3 * factor + 1];
    for (knot, (share, window)) in shares.into_iter().zip([&end, &middle, &middle]).enumerate() {
        let first = (3 - knot) * factor - window.before;
        let samples = weights[first..].iter_mut();
        samples.zip(&window.weights).for_each(|(sum, weight)| *sum += share * weight);
    }
    weights.iter().map(|weight| weight * weight).sum::<f64>().sqrt()
}

/// The position at each knot, `[knot, joint]`.
fn positions(y: Track<'_>, first: usize, factor: usize) -> Vec<f32> {
    let [start, middle, end] =
        [Window::after(factor), Window::around(factor), Window::before(factor)];
    let windows: Vec<(usize, &Window)> = (first..y.samples())
        .step_by(factor)
        .map(|knot| match knot {
            _ if knot < middle.before => (knot, &start),
            _ if knot + middle.before >= y.samples() => (knot - end.before, &end),
            _ => (knot - middle.before, &middle),
        })
        .collect();
    let mut positions = vec![0.0; windows.len() * y.joints()];
    for joint in 0..y.joints() {
        let values: Vec<f64> = y.joint(joint).map(f64::from).collect();
        let mean = |&(from, window): &(usize, &Window)| -> f64 {
            values[from..].iter().zip(&window.weights).map(|(value, weight)| value * weight).sum()
        };
        let means: Vec<f64> = windows.iter().map(mean).collect();
        let curvature = |knot: usize| match means.len() {
            2 => 0.0,
            count => {
                let at = knot.clamp(1, count - 2);
                let excess = |knot: usize| windows[knot].1.excess;
                // The curvature adds to the means, too, and not to all of them alike.
                let added = excess(at - 1) - 2.0 * excess(at) + excess(at + 1);
                (means[at - 1] - 2.0 * means[at] + means[at + 1]) / (1.0 + added)
            }
        };
        for (knot, (mean, (_, window))) in means.iter().zip(&windows).enumerate() {
            positions[knot * y.joints() + joint] = narrow(mean - window.excess * curvature(knot));
        }
    }
    positions
}

/// The mean torque from each of `knots` knots to the next, `[knot, joint]`. The last torque is held.
fn torques(u: Track<'_>, first: usize, factor: usize, knots: usize) -> Vec<f32> {
    let last = u.samples() - 1;
    let mean = |knot: usize, joint: usize| {
        let samples = (first + knot * factor..).take(factor);
        let sum: f64 = samples.map(|sample| f64::from(u[sample.min(last)][joint])).sum();
        narrow(sum / factor as f64)
    };
    (0..knots).flat_map(|knot| (0..u.joints()).map(move |joint| mean(knot, joint))).collect()
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
        let noise = MeasurementNoise::new(1e-4, 0.2);
        let series = Series::new(shape, 1000.0, u, y).unwrap().with_noise(noise);
        let decimated = Decimated::new(&series.observed(context), factor).unwrap().unwrap();
        (series, decimated)
    }

    #[test]
    fn knots_have_the_positions_of_their_time_and_the_impulse_between_them() {
        for (factor, context, samples) in [(16, 500, 700), (5, 503, 640), (2, 100, 101)] {
            let (_, decimated) = asked(factor, context, samples);
            let observed = decimated.observed();
            assert_eq!(observed.context(), 1 + (context - 1) / factor);
            assert!((observed.rate_hz() * factor as f64 - 1000.0).abs() < 1e-9);
            assert!((observed.noise().position_rad * (factor as f64).sqrt() - 1e-4).abs() < 1e-12);
            let first = (context - 1) % factor;
            let time = |knot: usize| (first + knot * factor) as f64 / 1000.0;
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
            let first = (context - 1) % factor;
            let first_knot = observed.context() - Decimated::BEHIND;
            let answer: Vec<f32> = (first_knot..observed.samples())
                .flat_map(|knot| {
                    let time = (first + knot * factor) as f64 / 1000.0;
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

    /// Each robot has its impulse at another sample, so the last positions are the samples' weights.
    #[test]
    fn the_noise_of_the_last_position_is_told() {
        for (factor, context) in [(16, 200), (4, 30), (3, 5)] {
            let shape = Shape { robots: context, samples: context + 1, joints: 1 };
            let mut y = vec![0.0; context * (context + 1)];
            y.iter_mut().step_by(context + 2).for_each(|position| *position = 1.0);
            let series = Series::new(shape, 1000.0, vec![0.0; y.len()], y).unwrap();
            let series = series.with_noise(MeasurementNoise::new(0.2, 0.0));
            let decimated = Decimated::new(&series.observed(context), factor).unwrap().unwrap();
            let observed = decimated.observed();
            let weight = |robot: usize| f64::from(observed.y(robot)[observed.context() - 1][0]);
            let squares: f64 = (0..context).map(|robot| weight(robot).powi(2)).sum();
            let told = observed.noise().last_position_rad;
            assert!((0.2 * squares.sqrt() / told - 1.0).abs() < 1e-5, "{factor}: {squares} {told}");
            assert!(told > 1.4 * observed.noise().position_rad);
        }
    }

    #[test]
    fn a_context_without_two_knots_has_no_lower_rate() {
        let (u, y) = recording(20, 1000.0);
        let series =
            Series::new(Shape { robots: 1, samples: 20, joints: 2 }, 1000.0, u, y).unwrap();
        assert!(Decimated::new(&series.observed(5), 5).unwrap().is_none());
        assert!(Decimated::new(&series.observed(9), 1).unwrap().is_none());
        assert!(Decimated::new(&series.observed(6), 5).unwrap().is_some());
    }
}
