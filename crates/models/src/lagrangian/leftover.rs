//! Residual torques of the law, added to draws: errors that the law makes in a context, it makes in
//! the horizon too.
//!
//! A draw adds a stretch of the residual torques of its robot's context to the torques of the
//! horizon. So its errors have the size, the frequencies and the differences between joints that
//! the context showed. A robot fits the motion to which it was fitted better than another motion.
//! So the residual torques of each part come from a robot that was fitted to the other parts.

use simd::InstructionSet;

use super::known::Known;
use super::law::Law;
use super::motion::Recorded;
use super::regression::Regression;

/// Parts of a context. Each is left out in turn.
const PARTS: usize = 4;

/// The residual torques of a context.
#[derive(Clone, Debug)]
pub(super) struct LeftOver {
    /// `[sample, joint]`, N·m.
    pub torques: Vec<f32>,
    pub joints: usize,
}

/// Standard normal numbers that choose the stretch of a draw.
pub(super) const NORMALS: usize = 3;

impl Law {
    /// The residual torques in the context of a robot.
    pub fn left_over(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        known: &Known,
    ) -> LeftOver {
        let y = known.smoothed.as_deref().unwrap_or(recorded.y);
        let path = Recorded { y, ..*recorded };
        let equations = self.equations_with(instructions, &path);
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
            let numbers = self.fit_with(&others, &path, known.posterior.bounds).mean;
            torques.extend(
                equations.of(part).map(|equation| equation.left_over(self.numbers, &numbers)),
            );
        }
        LeftOver { torques, joints: recorded.joints }
    }
}

impl LeftOver {
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

    use super::{LeftOver, NORMALS};

    const DRAWS: usize = 6000;

    /// The torques that each draw adds to a horizon of `samples` samples.
    fn added(left_over: &LeftOver, samples: usize) -> Vec<Vec<f32>> {
        let mut normals = vec![0.0; DRAWS * NORMALS];
        random::fill_normal(&mut normals, &mut ChaCha8Rng::seed_from_u64(3));
        let draws = normals.chunks_exact(NORMALS).map(|normals| {
            let mut u = vec![10.0; samples * left_over.joints];
            left_over.add(2.0, normals, &mut u);
            u.into_iter().map(|u| (u - 10.0) / 2.0).collect()
        });
        draws.collect()
    }

    #[test]
    fn every_stretch_of_the_context_is_as_likely_with_either_sign() {
        // Samples 1 to 5, of two joints.
        let torques = (1..=5).flat_map(|sample| [sample as f32, 0.1 * sample as f32]).collect();
        let left_over = LeftOver { torques, joints: 2 };
        let mut counts = [[0; 2]; 3];
        for stretch in added(&left_over, 3) {
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
    fn a_context_shorter_than_the_horizon_is_played_round_and_round() {
        let left_over = LeftOver { torques: vec![1.0, 2.0, 3.0], joints: 1 };
        let mut starts = [0; 3];
        for stretch in added(&left_over, 5) {
            let first = stretch[0].abs();
            let expected = (0..5).map(|sample| (first - 1.0 + sample as f32) % 3.0 + 1.0);
            for (torque, expected) in stretch.iter().zip(expected) {
                assert!((torque.abs() - expected).abs() < 1e-5, "{stretch:?}");
            }
            starts[first.round() as usize - 1] += 1;
        }
        assert!(starts.iter().all(|count| *count > DRAWS / 4), "{starts:?}");
        // Two samples have no equation.
        let nothing = LeftOver { torques: Vec::new(), joints: 1 };
        assert!(added(&nothing, 5).iter().flatten().all(|torque| *torque == 0.0));
    }
}
