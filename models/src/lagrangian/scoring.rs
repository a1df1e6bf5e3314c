//! How training learns what draws are to differ by: a proper score of what they say of horizons.
//!
//! The fair continuous ranked probability score (Ferro 2014) of a few draws, in units of how much draws without
//! [`Doubt`] differ at that sample and joint: errors of large motions and of small ones count alike. Around the
//! most likely robot, answers are linear in its numbers, so that draws are rolled out once and only their scale is
//! learned. A step does this for few of its robots.
//!
//! Horizons begin at their own first two samples, so that noise in the context's positions does not count: the
//! filter knows how much of it is left.

use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;
use simd::InstructionSet;

use super::batch::HostBatch;
#[cfg(doc)]
use super::known::Doubt;
use super::law::{Law, Start};
use super::motion::Recorded;
use super::numbers::Bounds;
use super::{Lagrangian, PACE, values};
use crate::randomness::Noise;

/// Draws of a robot: with the most likely one they fill the lanes of two vectors of eight.
pub(super) const DRAWS: usize = 7;

/// Least difference of draws that counts, rad; positions are computed in f32.
const LEAST_DIFFERENCE: f32 = 1e-6;

/// The score of one robot's draws.
#[derive(Debug)]
struct Score {
    value: f32,
    /// Its derivative by the scale of each draw.
    slopes: Vec<f32>,
    /// The number that the scale of each draw is made of.
    tails: Vec<f32>,
}

impl Lagrangian {
    /// The mean score over the batch `[1, 1, 1]`, of those robots that are drawn for it, one in
    /// [`Lagrangian::points`]; 0 where none is. Its gradient is that of [`Doubt`] alone.
    pub(super) fn score(
        &self,
        batch: &HostBatch,
        target: Tensor<3>,
        noise: &mut Noise,
    ) -> Tensor<3> {
        let [robots, horizon, joints] = target.dims();
        let doubt = self.doubt.val() * PACE;
        let device = doubt.device();
        let chosen = noise.below(self.points);
        let chosen: Vec<usize> = (0..robots).filter(|&robot| chosen[robot] == 0).collect();
        if chosen.is_empty() || horizon < 3 {
            // An optimizer wants a gradient at every step.
            return (doubt * 0.0).sum().unsqueeze();
        }
        let width = self.numbers.count() + 1;
        let normals = values(noise.normal([DRAWS, width], &device));
        let (target, law) = (values(target), self.law());
        let scores: Vec<Score> = chosen
            .into_par_iter()
            .map(|robot| {
                let y = &target[robot * horizon * joints..][..horizon * joints];
                let normals = &normals[robot * DRAWS * width..][..DRAWS * width];
                law.score(&batch.robot(robot), y, normals)
            })
            .collect();
        let each = |part: fn(&Score) -> &[f32]| {
            let all: Vec<f32> = scores.iter().flat_map(part).copied().collect();
            Tensor::<3>::from_data(TensorData::new(all, [scores.len(), DRAWS, 1]), &device)
        };
        let of = |place: usize| doubt.clone().narrow(0, place, 1).unsqueeze::<3>();
        let scales = (each(|score| &score.tails) * of(1) + of(0)).exp();
        // Each of those drawn stands for as many robots as were not.
        let share = self.points as f64 / robots as f64;
        let value: f64 = scores.iter().map(|score| f64::from(score.value)).sum();
        let varies = ((scales.clone() - scales.detach()) * each(|score| &score.slopes)).sum();
        (varies + value).unsqueeze::<3>() * share
    }
}

/// The fair continuous ranked probability score of samples `scales` · `differences` `[draw, entry]` for the truth
/// `error`, the mean over entries, and its derivative by each scale.
fn fair_crps(scales: &[f32], differences: &[f32], error: &[f32]) -> (f32, Vec<f32>) {
    let count = scales.len();
    let [each, pair] = [1.0 / count as f32, 1.0 / (count * (count - 1)) as f32];
    let mut slopes = vec![0.0; count];
    let mut value = 0.0;
    let entries = error.len();
    for (entry, error) in error.iter().enumerate() {
        let difference = |draw: usize| differences[draw * entries + entry];
        for (draw, scale) in scales.iter().enumerate() {
            let sample = scale * difference(draw);
            value += each * (sample - error).abs();
            let mut slope = each * sign(sample - error);
            for (other, scale) in scales.iter().enumerate() {
                let apart = sample - scale * difference(other);
                value -= 0.5 * pair * apart.abs();
                slope -= pair * sign(apart);
            }
            slopes[draw] += slope * difference(draw);
        }
    }
    let share = 1.0 / entries as f32;
    slopes.iter_mut().for_each(|slope| *slope *= share);
    (value * share, slopes)
}

/// 0 of 0.
fn sign(value: f32) -> f32 {
    if value == 0.0 { 0.0 } else { value.signum() }
}

impl Law {
    /// `y` are positions of the horizon, `normals` the numbers of each draw and of its scale.
    fn score(&self, robot: &Recorded<'_>, y: &[f32], normals: &[f32]) -> Score {
        let instructions = InstructionSet::best();
        let (joints, count) = (robot.joints, self.numbers.count());
        let (start, ahead) = y.split_at(2 * joints);
        let recorded = Recorded { u: &robot.u[robot.samples() * joints..], y: start, ..*robot };
        let draws = normals.chunks_exact(count + 1);
        let follow = |bounds| {
            let known = self.known(instructions, robot, bounds);
            let numbers: Vec<Vec<f32>> = std::iter::once(known.state.numbers.clone())
                .chain(draws.clone().map(|normals| {
                    self.deviate(instructions, robot, &known, 1.0, &normals[..count])
                }))
                .collect();
            let starts: Vec<Start<'_>> =
                numbers.iter().map(|numbers| Start { recorded, numbers }).collect();
            self.roll_out(instructions, &starts)
        };
        let mut answers = follow(Bounds::Own);
        let lost = answers.lost();
        if !lost.is_empty() {
            let without = follow(Bounds::Masses);
            lost.into_iter().for_each(|robot| answers.replace(robot, &without, robot));
        }
        let (mean, drawn) = answers.positions.split_at(ahead.len());
        let mut differences: Vec<f32> =
            drawn.iter().zip(mean.iter().cycle()).map(|(drawn, mean)| drawn - mean).collect();
        let mut error: Vec<f32> = ahead.iter().zip(mean).map(|(y, mean)| y - mean).collect();
        for (entry, error) in error.iter_mut().enumerate() {
            let each = || (0..DRAWS).map(|draw| draw * ahead.len() + entry);
            let squares: f32 = each().map(|at| differences[at] * differences[at]).sum();
            let unit = (squares / DRAWS as f32).sqrt().max(LEAST_DIFFERENCE);
            *error /= unit;
            each().for_each(|at| differences[at] /= unit);
        }
        let tails: Vec<f32> = draws.map(|normals| normals[count]).collect();
        let scales: Vec<f32> = tails.iter().map(|&tail| self.doubt.scale(tail)).collect();
        let (value, slopes) = fair_crps(&scales, &differences, &error);
        Score { value, slopes, tails }
    }
}

#[cfg(test)]
mod tests {
    use random::{ChaCha8Rng, SeedableRng};

    use super::{DRAWS, fair_crps};
    use crate::lagrangian::known::Doubt;

    #[test]
    fn the_score_and_its_slopes_are_those_of_the_definition() {
        // Two draws at two samples: 1 and 4, 0 and 0.5; times 1 and 2.
        let score = |scales: [f32; 2]| fair_crps(&scales, &[1.0, 0.0, 4.0, 0.5], &[2.0, 0.1]);
        let (value, slopes) = score([1.0, 2.0]);
        // |1 - 2| and |8 - 2|, less |1 - 8|; |0 - 0.1| and |1 - 0.1|, less |0 - 1|: halves, and their mean.
        assert!((value - 0.5 * (3.5 - 3.5 + 0.5 - 0.5)).abs() < 1e-6, "{value}");
        for draw in 0..2 {
            let moved = |by: f32| {
                let mut scales = [1.0, 2.0];
                scales[draw] += by;
                score(scales).0
            };
            let slope = (moved(0.01) - moved(-0.01)) / 0.02;
            assert!((slopes[draw] - slope).abs() < 1e-4, "{slopes:?} {slope}");
        }
    }

    /// Robots that differ as their draws do, times a log-normal scale: descent finds both of its numbers.
    #[test]
    fn the_scale_by_which_robots_differ_is_found() {
        const ROBOTS: usize = 20_000;
        let truth = Doubt { median: 0.7, tail: 0.5 };
        let mut generator = ChaCha8Rng::seed_from_u64(5);
        let mut normal = |count: usize| {
            let mut values = vec![0.0; count];
            random::fill_normal(&mut values, &mut generator);
            values
        };
        let scales = normal(ROBOTS).into_iter().map(|scale| truth.scale(scale));
        let errors: Vec<f32> =
            scales.zip(normal(ROBOTS)).map(|(scale, normal)| scale * normal).collect();
        let (differences, tails) = (normal(ROBOTS * DRAWS), normal(ROBOTS * DRAWS));
        let mut doubt = Doubt { median: 0.0, tail: 0.2 };
        for _ in 0..150 {
            let mut gradient = [0.0; 2];
            let draws = differences.chunks_exact(DRAWS).zip(tails.chunks_exact(DRAWS));
            for ((differences, tails), error) in draws.zip(&errors) {
                let scales: Vec<f32> = tails.iter().map(|&tail| doubt.scale(tail)).collect();
                let (_, slopes) = fair_crps(&scales, differences, &[*error]);
                for ((slope, scale), tail) in slopes.iter().zip(scales).zip(tails) {
                    gradient[0] += slope * scale / ROBOTS as f32;
                    gradient[1] += slope * scale * tail / ROBOTS as f32;
                }
            }
            doubt.median -= 1.5 * gradient[0];
            doubt.tail -= 1.5 * gradient[1];
        }
        assert!((doubt.median - truth.median).abs() < 0.05, "{doubt:?}");
        assert!((doubt.tail - truth.tail).abs() < 0.1, "{doubt:?}");
    }
}
