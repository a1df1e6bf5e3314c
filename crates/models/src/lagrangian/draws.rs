//! Draws of robots that a context allows.
//!
//! The numbers of a robot are normal given its context ([`super::regression`]), if the law is exact
//! and its errors at [`Law::points`] samples are independent. Both hold only nearly. So a draw also
//! adds residual torques of the law ([`ResidualTorques`]). Training learns how much more its robots
//! differ, and how much that itself varies from robot to robot ([`super::law::Calibration`]).
//!
//! Errors that the law makes in a context, it makes in the horizon too. So a draw adds a stretch of
//! the residual torques of its robot's context to the torques of the horizon. Its errors then have
//! the size, the frequencies and the differences between joints that the context showed. A robot
//! fits the motion to which it was fitted better than another motion. So the residual torques of
//! each part come from a robot that was fitted to the other parts. Where positions are noisy, residual
//! torques also contain what smoothing leaves of the noise. There a filter says how large the law's own
//! errors are ([`super::filtering`]), and the stretch is no larger.

use nalgebra::DVector;
use simd::InstructionSet;

use super::filtering::FilteredContext;
use super::fitting::{RobotPosterior, State};
use super::law::Law;
use super::recorded::Recorded;
use super::regression::Regression;

/// Parts of a context. Each is left out in turn.
const PARTS: usize = 4;
/// Standard normal numbers that choose the stretch of residual torques of a draw.
pub(super) const STRETCH: usize = 3;
/// Times that a draw is moved half-way to the most likely robot.
const HALVINGS: usize = 6;

/// A drawn robot at the end of its context.
#[derive(Clone, Debug)]
pub(super) struct RobotDraw {
    pub state: State,
    /// Torques that act on it, from the last sample but one of the context on, `[sample, joint]`,
    /// N·m.
    pub u: Vec<f32>,
}

/// The residual torques of a context.
#[derive(Clone, Debug)]
pub(super) struct ResidualTorques {
    /// `[sample, joint]`, N·m.
    pub torques: Vec<f32>,
    pub joints: usize,
}

impl Law {
    /// The residual torques in the context of a robot.
    pub fn residual_torques(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        posterior: &RobotPosterior,
    ) -> ResidualTorques {
        let filtered = posterior.filtered.as_ref();
        let y = filtered.map_or(recorded.y, |filtered| &filtered.smoothed);
        let path = Recorded { y, ..*recorded };
        let equations = self.equations_of(instructions, &path);
        let samples = equations.samples();
        let parts = (0..PARTS).map(|part| part * samples / PARTS..(part + 1) * samples / PARTS);
        let sums: Vec<Regression> = parts
            .clone()
            .map(|part| {
                let mut sums = Regression::new(self.numbers);
                equations.of(part).for_each(|equation| sums.add(&equation));
                sums
            })
            .collect();
        let mut torques = Vec::with_capacity(samples * recorded.joints);
        for (left_out, part) in parts.enumerate() {
            let mut others = Regression::new(self.numbers);
            let seen = sums.iter().enumerate().filter(|(part, _)| *part != left_out);
            seen.for_each(|(_, sums)| others.add_all(sums));
            let numbers = self.fit_with(&others, &path, posterior.numbers.bounds, None).mean;
            torques.extend(
                equations.of(part).map(|equation| equation.residual_torque(self.numbers, &numbers)),
            );
        }
        let mut residuals = ResidualTorques { torques, joints: recorded.joints };
        if let Some(filtered) = filtered {
            residuals.keep_within(&filtered.law_errors);
        }
        residuals
    }

    /// Standard normal numbers of a draw: one for each number of a robot, one for its scale, those of
    /// [`ResidualTorques`], one for each angle and one for each velocity.
    pub fn normals_per_draw(&self) -> usize {
        self.numbers.count() + 1 + STRETCH + 2 * self.numbers.joints
    }

    /// Draws a robot that the context allows.
    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    pub fn draw(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        posterior: &RobotPosterior,
        residuals: &ResidualTorques,
        normals: &[f32],
    ) -> RobotDraw {
        let (of_numbers, normals) = normals.split_at(self.numbers.count());
        let (of_scale, normals) = normals.split_at(1);
        let (of_torques, of_motion) = normals.split_at(STRETCH);
        let scale = self.calibration.scale(of_scale[0]);
        let mut u = posterior.disturbance.less(recorded);
        residuals.add(scale * self.calibration.log_torque.exp(), of_torques, &mut u);
        let mut state = State {
            numbers: self.draw_numbers(instructions, recorded, posterior, scale, of_numbers),
            ..posterior.most_likely.clone()
        };
        if let Some(FilteredContext { motion: root, .. }) = &posterior.filtered {
            let joints = self.numbers.joints;
            let normals = of_motion.iter().copied().map(f64::from);
            let moved = root * DVector::from_iterator(2 * joints, normals);
            for joint in 0..joints {
                let [angle, velocity] = [moved[joint] as f32, moved[joints + joint] as f32];
                state.y[joint] += angle - velocity / recorded.rate_hz;
                state.y[joints + joint] += angle;
            }
        }
        RobotDraw { state, u }
    }

    /// Numbers at a distance of `scale` standard deviations of the regression from the most likely
    /// ones. The distance is halved while some pose of the context would have too little inertia.
    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    pub fn draw_numbers(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        posterior: &RobotPosterior,
        scale: f32,
        normals: &[f32],
    ) -> Vec<f32> {
        let deviation = posterior.numbers.deviation(normals);
        let mut scale = scale;
        for _ in 0..HALVINGS {
            let each = posterior.most_likely.numbers.iter().zip(&deviation);
            let mut numbers: Vec<f32> =
                each.map(|(number, more)| scale.mul_add(*more as f32, *number)).collect();
            self.numbers.keep_bounds(&mut numbers, posterior.numbers.bounds);
            if self.has_enough_inertia(instructions, recorded, &numbers) {
                return numbers;
            }
            scale *= 0.5;
        }
        posterior.most_likely.numbers.clone()
    }
}

impl ResidualTorques {
    /// Makes the torques of a joint smaller where their root mean square is above the joint's
    /// deviation, N·m.
    fn keep_within(&mut self, deviations: &[f32]) {
        let joints = self.joints;
        let samples = (self.torques.len() / joints) as f32;
        for (joint, deviation) in deviations.iter().enumerate() {
            let of_joint = || self.torques.iter().skip(joint).step_by(joints);
            let size = (of_joint().map(|torque| torque * torque).sum::<f32>() / samples).sqrt();
            if size > *deviation {
                let torques = self.torques.iter_mut().skip(joint).step_by(joints);
                torques.for_each(|torque| *torque *= deviation / size);
            }
        }
    }

    /// Adds a stretch, times `scale`, to torques `[sample, joint]`. Every stretch that fits into
    /// the context is equally likely, with either sign. A context that is too short is repeated.
    pub fn add(&self, scale: f32, normals: &[f32], u: &mut [f32]) {
        let samples = self.torques.len() / self.joints;
        if samples == 0 {
            return;
        }
        let starts = match samples.checked_sub(u.len() / self.joints) {
            Some(more) => more + 1,
            None => samples,
        };
        let side = side(normals);
        let first = place(side.abs(), starts) * self.joints;
        let stretch = self.torques.iter().cycle().skip(first);
        for (u, torque) in u.iter_mut().zip(stretch) {
            *u += scale.copysign(side) * torque;
        }
    }
}

/// A number uniform on -1 to 1, from three standard normal ones: the area of a zone of a sphere is
/// proportional to its height (Archimedes).
fn side(normals: &[f32]) -> f32 {
    let squares: f32 = normals.iter().map(|normal| normal * normal).sum();
    match normals {
        [.., last] if squares > 0.0 => last / squares.sqrt(),
        _ => 0.0,
    }
}

/// The index of the interval that contains `share`, where `count` intervals of equal width divide 0
/// to 1.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a share of a count of samples"
)]
fn place(share: f32, count: usize) -> usize {
    ((share * count as f32) as usize).min(count - 1)
}

#[cfg(test)]
mod tests {
    #![expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "small whole numbers"
    )]

    use random::{ChaCha8Rng, SeedableRng};

    use super::{ResidualTorques, STRETCH};

    const DRAWS: usize = 6000;

    /// The torques that each draw adds to a horizon of `samples` samples.
    fn added(residuals: &ResidualTorques, samples: usize) -> Vec<Vec<f32>> {
        let mut normals = vec![0.0; DRAWS * STRETCH];
        random::fill_normal(&mut normals, &mut ChaCha8Rng::seed_from_u64(3));
        let draws = normals.chunks_exact(STRETCH).map(|normals| {
            let mut u = vec![10.0; samples * residuals.joints];
            residuals.add(2.0, normals, &mut u);
            u.into_iter().map(|u| (u - 10.0) / 2.0).collect()
        });
        draws.collect()
    }

    #[test]
    fn every_stretch_of_the_context_is_as_likely_with_either_sign() {
        // Samples 1 to 5, of two joints.
        let torques = (1..=5).flat_map(|sample| [sample as f32, 0.1 * sample as f32]).collect();
        let residuals = ResidualTorques { torques, joints: 2 };
        let mut counts = [[0; 2]; 3];
        for stretch in added(&residuals, 3) {
            let sign = stretch[0].signum();
            let first = stretch[0].abs().round() as usize;
            for (sample, torques) in (first..).zip(stretch.chunks_exact(2)) {
                assert!((torques[0] - sign * sample as f32).abs() < 1e-5, "{stretch:?}");
                assert!((torques[1] - 0.1 * sign * sample as f32).abs() < 1e-5, "{stretch:?}");
            }
            counts[first - 1][usize::from(sign > 0.0)] += 1;
        }
        // Four standard deviations of a count with probability one sixth.
        let near = |count: &usize| count.abs_diff(DRAWS / 6) < 120;
        assert!(counts.as_flattened().iter().all(near), "{counts:?}");
    }

    #[test]
    fn torques_are_made_as_small_as_they_are_said_to_be_and_never_larger() {
        let torques = vec![3.0, 0.1, -3.0, -0.1, 3.0, 0.1];
        let mut residuals = ResidualTorques { torques, joints: 2 };
        residuals.keep_within(&[1.0, 1.0]);
        let expected = [1.0, 0.1, -1.0, -0.1, 1.0, 0.1];
        let pairs = residuals.torques.iter().zip(expected);
        assert!(pairs.clone().all(|(torque, expected)| (torque - expected).abs() < 1e-6));
        let mut nothing = ResidualTorques { torques: Vec::new(), joints: 2 };
        nothing.keep_within(&[1.0, 1.0]);
        assert!(nothing.torques.is_empty());
    }

    #[test]
    fn a_context_shorter_than_the_horizon_is_played_round_and_round() {
        let residuals = ResidualTorques { torques: vec![1.0, 2.0, 3.0], joints: 1 };
        let mut starts = [0; 3];
        for stretch in added(&residuals, 5) {
            let first = stretch[0].abs();
            let expected = (0..5).map(|sample| (first - 1.0 + sample as f32) % 3.0 + 1.0);
            for (torque, expected) in stretch.iter().zip(expected) {
                assert!((torque.abs() - expected).abs() < 1e-5, "{stretch:?}");
            }
            starts[first.round() as usize - 1] += 1;
        }
        assert!(starts.iter().all(|count| *count > DRAWS / 4), "{starts:?}");
        // Two samples have no equation.
        let nothing = ResidualTorques { torques: Vec::new(), joints: 1 };
        assert!(added(&nothing, 5).iter().flatten().all(|torque| *torque == 0.0));
    }
}
