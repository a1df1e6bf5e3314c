//! The damped integrator whose velocity follows u / D with a lag, and its error over a context.

use series::Track;

/// Distance between two starts of a path in the context, samples.
const STRIDE: usize = 8;

/// The smallest error of a path, rad. It is the resolution of a good encoder.
const LEAST_ERROR_RAD: f64 = 1e-5;

/// The smallest error as a share of the path's own displacement, because a context at rest shows no
/// errors.
const LEAST_ERROR: f64 = 0.02;

/// The path of one joint of one robot: v' = v + α (u / D - v), q' = q + v' h. It is a mass M behind
/// a damping D. α = h D / M where that is small, and 1 without mass.
pub(crate) struct LaggedPath {
    /// The measured positions, rad.
    measured: Vec<f64>,
    /// The displacement in each sample of context and horizon without a lag, rad.
    driven: Vec<f64>,
    /// α.
    share: f64,
}

impl LaggedPath {
    /// Fits α to the context by least squares. In each sample the velocity moves towards u / D by
    /// the share α of its distance from u / D, so α is the slope of the changes over the distances.
    /// Where nothing moves it is 1, which means no lag.
    pub fn fit(u: Track<'_>, y: Track<'_>, joint: usize, damping: f64, rate_hz: f64) -> Self {
        let gain = 1.0 / (damping * rate_hz);
        let measured: Vec<f64> = y.joint(joint).map(f64::from).collect();
        let driven: Vec<f64> = u.joint(joint).map(|torque| gain * f64::from(torque)).collect();
        let (mut products, mut squares) = (0.0, 0.0);
        for (three, driven) in measured.windows(3).zip(&driven[1..]) {
            let (moved, moves) = (three[1] - three[0], three[2] - three[1]);
            let left = driven - moved;
            products += left * (moves - moved);
            squares += left * left;
        }
        let share = if squares > 0.0 { (products / squares).clamp(0.01, 1.0) } else { 1.0 };
        Self { measured, driven, share }
    }

    /// The displacement in the sample before `start`, rad. Before the first sample it is the one
    /// without a lag.
    fn step_before(&self, start: usize) -> f64 {
        match start.checked_sub(1) {
            Some(before) => self.measured[start] - self.measured[before],
            None => self.driven[start],
        }
    }

    /// For each of the `horizon` samples after the context, the path and its error. The error after
    /// k samples is the root mean square, over all starts in the context, of the path's error after
    /// k samples. It never falls with k.
    pub fn ahead(&self, horizon: usize) -> Vec<(f64, f64)> {
        let last = self.measured.len() - 1;
        // All starts advance side by side. A single path would wait for each of its own additions.
        let starts = || (1..last).step_by(STRIDE);
        let mut positions: Vec<f64> = starts().map(|start| self.measured[start]).collect();
        let mut steps: Vec<f64> = starts().map(|start| self.step_before(start)).collect();
        let driven = Strided::new(&self.driven[1..]);
        let measured = Strided::new(&self.measured[1..]);
        let (begin, mut position, mut step) =
            (self.measured[last], self.measured[last], self.step_before(last));
        let mut error = LEAST_ERROR_RAD;
        let ahead = (0..horizon).map(|k| {
            let unfinished = last.saturating_sub(k + 1).div_ceil(STRIDE);
            positions.truncate(unfinished);
            let driven = driven.from(k, unfinished);
            for ((position, step), driven) in positions.iter_mut().zip(&mut steps).zip(driven) {
                *step += self.share * (driven - *step);
                *position += *step;
            }
            if unfinished > 0 {
                let squares = squared_distance(&positions, measured.from(k + 1, unfinished));
                error = error.max((squares / unfinished as f64).sqrt());
            }
            step += self.share * (self.driven[last + k] - step);
            position += step;
            error = error.max(LEAST_ERROR * (position - begin).abs());
            (position, error)
        });
        ahead.collect()
    }
}

/// A series in another order: values that were [`STRIDE`] apart are neighbours.
struct Strided([Vec<f64>; STRIDE]);

impl Strided {
    fn new(values: &[f64]) -> Self {
        Self(std::array::from_fn(|first| {
            values.iter().skip(first).step_by(STRIDE).copied().collect()
        }))
    }

    /// `count` values from `first` on, [`STRIDE`] apart.
    fn from(&self, first: usize, count: usize) -> &[f64] {
        &self.0[first % STRIDE][first / STRIDE..][..count]
    }
}

/// Σ (a - b)².
fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    /// A sum of one term after the other would wait for each addition.
    const SUMS: usize = 8;
    let ((a_blocks, a_rest), (b_blocks, b_rest)) = (a.as_chunks::<SUMS>(), b.as_chunks::<SUMS>());
    let mut sums = [0.0; SUMS];
    for (a, b) in a_blocks.iter().zip(b_blocks) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += (a - b) * (a - b);
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| (a - b) * (a - b)).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use series::{Series, Shape};

    use super::*;

    /// A joint of damping 10 whose velocity follows with `share`, pushed by a wave.
    fn arm(share: f32) -> Series {
        let u: Vec<f32> = (0..120).map(|k| 5.0 * (0.1 * k as f32).sin()).collect();
        let (mut y, mut step) = (vec![0.3], 0.0);
        for torque in &u[..119] {
            step += share * (torque / 600.0 - step);
            y.push(y[y.len() - 1] + step);
        }
        Series::new(Shape { robots: 1, samples: 120, joints: 1 }, 60.0, u, y).unwrap()
    }

    fn path(observed: &series::Observed<'_>) -> Vec<(f64, f64)> {
        LaggedPath::fit(observed.u(0), observed.y(0), 0, 10.0, 60.0).ahead(20)
    }

    #[test]
    fn an_arm_with_a_lag_is_followed_and_its_error_is_known_to_be_small() {
        for share in [0.05, 0.3, 1.0] {
            let arm = arm(share);
            for (k, (position, error)) in path(&arm.observed(100)).into_iter().enumerate() {
                let truth = f64::from(arm.y()[100 + k]);
                assert!((position - truth).abs() < 2e-4, "{share}: {k}, {position} {truth}");
                // A fiftieth of the way, which is about 0.1 rad.
                assert!(error < 3e-3, "{share}: {k}, {error}");
            }
        }
    }

    #[test]
    fn errors_begin_small_and_grow_with_the_way() {
        // A damping of 8, which differs from the path's.
        let mut arm = arm(0.3);
        let start = arm.y()[0];
        arm.y_mut().iter_mut().for_each(|y| *y = start + (*y - start) / 0.8);
        let ahead = path(&arm.observed(100));
        assert!(ahead[0].1 < 0.1 * ahead[19].1, "{ahead:?}");
        assert!(ahead.windows(2).all(|pair| pair[0].1 <= pair[1].1), "{ahead:?}");
        let first = f64::from(arm.y()[100]) - ahead[0].0;
        assert!(first.abs() < 3.0 * ahead[0].1, "{first} {ahead:?}");
    }

    #[test]
    fn a_context_at_rest_leaves_room_for_a_share_of_the_way() {
        let u: Vec<f32> = (0..120).map(|k| if k < 100 { 0.0 } else { 5.0 }).collect();
        let shape = Shape { robots: 1, samples: 120, joints: 1 };
        let arm = Series::new(shape, 60.0, u, vec![0.3; 120]).unwrap();
        let ahead = path(&arm.observed(100));
        assert!(ahead[0].1 >= LEAST_ERROR_RAD, "{ahead:?}");
        assert!(ahead[19].1 > 1e-3, "{ahead:?}");
        assert!(ahead.iter().all(|(position, error)| position.is_finite() && error.is_finite()));
    }
}
