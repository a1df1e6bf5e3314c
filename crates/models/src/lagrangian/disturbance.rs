//! The torque that a law does not explain at the end of a context, and how long it lasts.
//!
//! Part of the residual torque is noise, and part of it is slow: a friction that is a little stronger
//! than the law says stays so while a joint turns. The slow part of each joint is a Gauss-Markov
//! process, which forgets its value within a time constant, and the rest is white. A Kalman filter of
//! the residual torques of a context says how large the slow part is at its end. Its time constant and
//! its share of the variance are those under which the context is most likely.

use simd::InstructionSet;

use super::law::Law;
use super::recorded::Recorded;

/// Time constants that are tried, s.
const TIMES_S: [f64; 4] = [0.1, 0.3, 1.0, 3.0];
/// Ratios of the slow part's variance to that of the white part that are tried.
const RATIOS: [f64; 5] = [0.1, 0.3, 1.0, 3.0, 10.0];
/// The fewest residual torques of a joint that a filter is chosen by.
const FEWEST: usize = 16;

/// The slow part of the residual torque at the end of a context.
#[derive(Clone, Debug, Default)]
pub(super) struct Disturbance {
    /// Each joint has a torque in N·m and the share of it that is left after a sample.
    joints: Vec<(f32, f32)>,
}

impl Law {
    /// The slow part of the residual torques of a context, of the robot with these numbers, for a law
    /// that takes it into account.
    pub fn disturbance(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        numbers: &[f64],
    ) -> Disturbance {
        let (of, joints) = (self.numbers, self.numbers.joints);
        if !self.disturbance {
            return Disturbance::default();
        }
        let equations = self.equations_of(instructions, recorded);
        if equations.samples() < FEWEST {
            return Disturbance::default();
        }
        let rows = equations.of(0..equations.samples());
        let residuals: Vec<f64> =
            rows.map(|equation| f64::from(equation.residual_torque(of, numbers))).collect();
        let rate_hz = f64::from(recorded.rate_hz);
        let of_joint = |joint: usize| {
            let residuals: Vec<f64> =
                residuals.iter().skip(joint).step_by(joints).copied().collect();
            Filtered::most_likely(&residuals, rate_hz).last()
        };
        Disturbance { joints: (0..joints).map(of_joint).collect() }
    }
}

impl Disturbance {
    /// The torques from the last sample but one of the context on, less the slow part,
    /// `[sample, joint]`, N·m.
    pub fn less(&self, recorded: &Recorded<'_>) -> Vec<f32> {
        let mut u = recorded.u[recorded.before()..].to_vec();
        for (joint, &(torque, left)) in self.joints.iter().enumerate() {
            let mut torque = torque;
            for u in u.iter_mut().skip(joint).step_by(recorded.joints) {
                *u -= torque;
                torque *= left;
            }
        }
        u
    }
}

/// The slow part of a joint's residual torque, by a filter.
struct Filtered {
    /// N·m.
    torque: f64,
    /// The share that is left after a sample.
    left: f64,
    negative_log_likelihood: f64,
}

impl Filtered {
    /// The filter under which these torques are most likely. Without a slow part there is none.
    fn most_likely(residuals: &[f64], rate_hz: f64) -> Self {
        let filters = TIMES_S.into_iter().flat_map(|time_s| {
            let left = (-1.0 / (time_s * rate_hz)).exp();
            RATIOS.map(|ratio| Self::run(residuals, left, ratio))
        });
        let white = Self::run(residuals, 0.0, 0.0);
        filters.fold(white, |best, found| {
            if found.negative_log_likelihood < best.negative_log_likelihood { found } else { best }
        })
    }

    /// The white part has a variance of 1 here. The most likely scale of both is that of the
    /// innovations.
    fn run(residuals: &[f64], left: f64, ratio: f64) -> Self {
        let (mut torque, mut variance) = (0.0, ratio);
        let (mut squares, mut logarithms) = (0.0, 0.0);
        for residual in residuals {
            let expected = variance + 1.0;
            let off = residual - torque;
            squares += off * off / expected;
            logarithms += expected.ln();
            let gain = variance / expected;
            torque = left * (torque + gain * off);
            variance = left * left * (1.0 - gain) * variance + (1.0 - left * left) * ratio;
        }
        let count = residuals.len() as f64;
        let scale = (squares / count).max(f64::MIN_POSITIVE);
        let negative_log_likelihood = 0.5 * (count * scale.ln() + logarithms);
        Self { torque, left, negative_log_likelihood }
    }

    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    fn last(&self) -> (f32, f32) {
        if self.torque.is_finite() { (self.torque as f32, self.left as f32) } else { (0.0, 0.0) }
    }
}

#[cfg(test)]
mod tests {
    use random::{ChaCha8Rng, SeedableRng};

    use super::*;

    /// A Gauss-Markov process of variance `ratio` and white noise of variance 1, and the process at
    /// the sample after the last one.
    fn torques(left: f64, ratio: f64, samples: usize, seed: u64) -> (Vec<f64>, f64) {
        let mut normals = vec![0.0; 2 * samples];
        random::fill_normal_portably(&mut normals, &mut ChaCha8Rng::seed_from_u64(seed));
        let mut slow = 0.0;
        let each = normals.chunks_exact(2).map(|normal| {
            let residual = slow + normal[0];
            slow = left * slow + ((1.0 - left * left) * ratio).sqrt() * normal[1];
            residual
        });
        let residuals: Vec<f64> = each.collect();
        (residuals, slow)
    }

    #[test]
    fn a_slow_torque_is_found_at_the_end_and_a_white_one_is_not() {
        let left = (-1.0_f64 / 30.0).exp();
        let [mut found, mut nothing, mut white] = [0.0; 3];
        for seed in 0..200 {
            let (residuals, slow) = torques(left, 4.0, 80, seed);
            let filtered = Filtered::most_likely(&residuals, 30.0);
            found += (filtered.torque - slow).powi(2) / 200.0;
            nothing += slow.powi(2) / 200.0;
            let (residuals, _) = torques(0.0, 0.0, 80, seed);
            white += Filtered::most_likely(&residuals, 30.0).torque.powi(2) / 200.0;
        }
        assert!(found < 0.25 * nothing, "{found} {nothing}");
        assert!(white < 0.02, "{white}");
    }

    #[test]
    fn torques_that_vanish_or_are_not_finite_leave_no_disturbance() {
        for value in [0.0, f64::NAN, f64::INFINITY] {
            let (torque, left) = Filtered::most_likely(&[value; 40], 60.0).last();
            assert_eq!(torque, 0.0);
            assert!((0.0..=1.0).contains(&left));
        }
    }

    #[test]
    fn it_is_taken_off_the_torques_and_decays() {
        let disturbance = Disturbance { joints: vec![(1.0, 0.5), (0.0, 0.9)] };
        let recorded = Recorded { u: &[3.0; 10], y: &[0.0; 6], joints: 2, rate_hz: 60.0 };
        assert_eq!(disturbance.less(&recorded), [2.0, 3.0, 2.5, 3.0, 2.75, 3.0, 2.875, 3.0]);
    }
}
