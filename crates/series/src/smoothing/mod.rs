//! Removes measurement noise from positions: Kalman smoothing of the motion of joints.
//!
//! The model of a joint's motion has white jerk: the acceleration is a random walk. The standard
//! deviation of the noise is known. Then a forward pass (Kalman 1960) and a backward pass (the
//! adjoint form of Bryson and Frazier 1963, which inverts no covariance) give the most likely
//! positions. The intensity of the jerk is chosen for each joint by the likelihood of its measured
//! positions, so that a slow joint is smoothed more.

mod gains;
mod low_pass;

use gains::{Gains, State};
pub use low_pass::LowPass;

/// The range of the jerk's intensity, rad²/s⁵: from joints that hardly move to wrists that follow
/// torques of a few Hz.
const LEAST_INTENSITY: f64 = 1e-7;
const INTENSITIES: usize = 29;
/// The ratio of neighbouring intensities, √10. The filter's bandwidth grows with the sixth root, by
/// 21 %.
const RATIO: f64 = 3.162_277_660_168_379_5;

/// A smoother of motions of one length, rate and noise.
#[derive(Clone, Debug)]
pub struct Smoother {
    /// The gains for each intensity, in rising order.
    gains: Vec<Gains>,
}

impl Smoother {
    /// A smoother for motions of `samples` samples at `rate_hz` with noise of `deviation_rad`,
    /// which is above 0.
    pub fn new(samples: usize, rate_hz: f64, deviation_rad: f64) -> Self {
        let intensities = std::iter::successors(Some(LEAST_INTENSITY), |last| Some(last * RATIO));
        let gains = intensities
            .take(INTENSITIES)
            .map(|intensity| Gains::new(samples, rate_hz, deviation_rad, intensity));
        Self { gains: gains.collect() }
    }

    /// The smoothed positions of one joint, rad. Their number must be that of [`Smoother::new`].
    pub fn smooth(&self, measured: &[f64]) -> Vec<f64> {
        let Some(most_likely) = self.most_likely(measured) else { return measured.to_vec() };
        let filtered = most_likely.filter(measured);
        most_likely.smooth(filtered).into_iter().map(|state| state[0]).collect()
    }

    /// The smoothed positions `[sample, joint]` of a robot, rad.
    #[expect(clippy::cast_possible_truncation, reason = "series hold f32")]
    pub fn smooth_robot(&self, measured: &[f32], joints: usize) -> Vec<f32> {
        let mut smoothed = measured.to_vec();
        for joint in 0..joints {
            let of_joint = measured.iter().skip(joint).step_by(joints);
            let of_joint: Vec<f64> = of_joint.map(|&q| f64::from(q)).collect();
            let places = smoothed.iter_mut().skip(joint).step_by(joints);
            for (place, q) in places.zip(self.smooth(&of_joint)) {
                *place = q as f32;
            }
        }
        smoothed
    }

    /// The gains of the most likely intensity. The likelihood has one maximum over the logarithm of
    /// the intensity, and the search climbs from the middle.
    fn most_likely(&self, measured: &[f64]) -> Option<&Gains> {
        let surprise = |place: usize| self.gains[place].surprise(measured);
        let mut place = self.gains.len() / 2;
        let mut least = surprise(place);
        for direction in [1, -1] {
            while let Some(next) = place.checked_add_signed(direction)
                && next < self.gains.len()
            {
                let found = surprise(next);
                if found >= least {
                    break;
                }
                (place, least) = (next, found);
            }
        }
        self.gains.get(place)
    }
}

/// The filter's state after a sample: its estimate, and the difference of the measured position
/// from the expected one.
#[derive(Clone, Copy, Debug)]
struct Filtered {
    state: State,
    innovation: f64,
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "series hold f32")]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 60.0;

    /// Approximately normal noise: sums of four numbers of a linear congruential generator.
    fn noise(count: usize) -> Vec<f64> {
        let mut state = 12_345_u64;
        let mut unit = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        };
        (0..count).map(|_| 3.0_f64.sqrt() * (0..4).map(|_| unit()).sum::<f64>()).collect()
    }

    fn motion(hertz: f64, samples: usize) -> Vec<f64> {
        let phase = |k: usize| std::f64::consts::TAU * hertz * k as f64 / RATE_HZ;
        (0..samples).map(|k| 0.3 * phase(k).sin() + 1.0).collect()
    }

    fn deviation(a: &[f64], b: &[f64]) -> f64 {
        let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        (squares / a.len() as f64).sqrt()
    }

    #[test]
    fn slow_motions_are_smoothed_more_than_fast_ones_and_all_lose_noise() {
        for deviation_rad in [1e-4, 1e-3] {
            let smoother = Smoother::new(320, RATE_HZ, deviation_rad);
            let left = [0.1, 0.5, 2.0].map(|hertz| {
                let truth = motion(hertz, 320);
                let measured: Vec<f64> =
                    truth.iter().zip(noise(320)).map(|(q, n)| q + deviation_rad * n).collect();
                deviation(&smoother.smooth(&measured), &truth) / deviation_rad
            });
            assert!(left[0] < left[1] && left[1] < left[2] && left[2] < 0.95, "{left:?}");
            assert!(left[0] < 0.35, "{left:?}");
        }
    }

    #[test]
    fn a_joint_that_stands_still_is_averaged() {
        let measured: Vec<f64> = noise(320).into_iter().map(|n| 0.7 + 1e-3 * n).collect();
        let smoothed = Smoother::new(320, RATE_HZ, 1e-3).smooth(&measured);
        assert!(smoothed.iter().all(|q| (q - 0.7).abs() < 5e-4), "{smoothed:?}");
    }

    #[test]
    fn short_and_wild_motions_have_finite_answers() {
        for samples in [1, 2, 3, 10] {
            for (scale, deviation_rad) in [(0.0, 0.1), (1e6, 1e-9), (1.0, 1e-9), (1e-3, 0.1)] {
                let measured: Vec<f64> = noise(samples).iter().map(|n| scale * n).collect();
                let smoothed = Smoother::new(samples, RATE_HZ, deviation_rad).smooth(&measured);
                assert_eq!(smoothed.len(), samples);
                assert!(smoothed.iter().all(|q| q.is_finite()), "{smoothed:?}");
            }
        }
    }

    #[test]
    fn joints_of_a_robot_do_not_feel_each_other() {
        let smoother = Smoother::new(40, RATE_HZ, 1e-3);
        let columns = [motion(0.4, 40), motion(1.3, 40)];
        let rows: Vec<f32> = (0..80).map(|k| columns[k % 2][k / 2] as f32).collect();
        let smoothed = smoother.smooth_robot(&rows, 2);
        for (joint, column) in columns.iter().enumerate() {
            let column: Vec<f64> = column.iter().map(|&q| f64::from(q as f32)).collect();
            let alone = smoother.smooth(&column);
            let together = smoothed.iter().skip(joint).step_by(2);
            assert!(together.zip(alone).all(|(a, b)| *a == b as f32));
        }
    }
}
