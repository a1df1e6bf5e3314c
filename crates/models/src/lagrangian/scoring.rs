//! How training learns the spread of draws: by a proper score of their horizons.
//!
//! The score is the fair continuous ranked probability score (Ferro 2014) of a few draws. Its unit
//! is the spread of draws before their [`Calibration`] at that sample and joint, so that errors of large and
//! of small motions count alike. Around the most likely robot, answers are linear in its numbers
//! and in torques. So a draw is rolled out twice, once with its numbers and once with its torques,
//! and only the scales of both are learned. A step does this for a few of its robots.
//!
//! These horizons begin at their own first two samples, so that noise in the context's positions
//! does not count. The filter estimates that noise.

use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;
use simd::InstructionSet;

use super::batch::HostBatch;
use super::draws::STRETCH;
use super::law::{Calibration, Law};
use super::recorded::Recorded;
use super::regression::Bounds;
use super::rollout::Start;
use super::{CALIBRATION_PACE, Lagrangian, values};
use crate::randomness::Noise;

/// Draws of a robot. The most likely robot, the draws' numbers and the draws' torques fill the
/// lanes of two vectors of eight.
pub(super) const DRAWS: usize = 7;

/// One robot of so many is scored where [`Lagrangian::points`] are more. A part of a batch does not know
/// how large the batch is.
const SCORED: usize = 12;

/// The least unit of the score, rad, because positions are computed in f32.
const LEAST_DIFFERENCE: f32 = 1e-6;

/// The score of one robot's draws.
#[derive(Debug)]
struct Score {
    value: f32,
    /// The derivative of the score by the scale of each draw.
    slopes: Vec<f32>,
    /// The derivative of the score by the logarithm of the share of torques.
    slope_of_torque: f32,
    /// The standard normal number behind the scale of each draw.
    normals: Vec<f32>,
}

impl Score {
    /// The score of draws. Their numbers change the answer by `of_numbers`, and their torques
    /// change it by `of_torques`, `[draw, entry]` each, in the units of `error`.
    fn new(
        calibration: Calibration,
        normals: Vec<f32>,
        (of_numbers, of_torques): (&[f32], &[f32]),
        error: &[f32],
    ) -> Self {
        let entries = error.len();
        let share = calibration.log_torque.exp();
        let scales: Vec<f32> = normals.iter().map(|&normal| calibration.scale(normal)).collect();
        let each = of_numbers.iter().zip(of_torques);
        let together: Vec<f32> =
            each.map(|(numbers, torques)| share.mul_add(*torques, *numbers)).collect();
        let scaled = together.chunks_exact(entries).zip(&scales);
        let samples: Vec<f32> =
            scaled.flat_map(|(draw, scale)| draw.iter().map(move |entry| scale * entry)).collect();
        let (value, slopes) = fair_crps(&samples, error);
        let along = |differences: &[f32]| -> Vec<f32> {
            let draws = slopes.chunks_exact(entries).zip(differences.chunks_exact(entries));
            draws.map(|(slopes, draw)| slopes.iter().zip(draw).map(|(a, b)| a * b).sum()).collect()
        };
        let by_torques = along(of_torques);
        let slope_of_torque = by_torques.iter().zip(&scales).map(|(by, scale)| share * by * scale);
        let (slope_of_torque, slopes) = (slope_of_torque.sum(), along(&together));
        Self { value, slopes, slope_of_torque, normals }
    }
}

impl Lagrangian {
    /// The mean score over the batch `[1, 1, 1]`. It is estimated from a random choice of robots,
    /// one in [`Lagrangian::points`] or in [`SCORED`], and is 0 where none is chosen. Only
    /// [`Calibration`] has a gradient.
    pub(super) fn score(
        &self,
        batch: &HostBatch,
        target: Tensor<3>,
        noise: &mut Noise,
    ) -> Tensor<3> {
        let [robots, horizon, joints] = target.dims();
        let calibration = self.doubt.val() * CALIBRATION_PACE;
        let device = calibration.device();
        let one_in = self.points.min(SCORED);
        let chosen = noise.below(one_in);
        let chosen: Vec<usize> = (0..robots).filter(|&robot| chosen[robot] == 0).collect();
        if chosen.is_empty() || horizon < 3 {
            // The optimizer needs a gradient at every step.
            return (calibration * 0.0).sum().unsqueeze();
        }
        let width = self.numbers.count() + 1 + STRETCH;
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
        let of = |place: usize| calibration.clone().narrow(0, place, 1).unsqueeze::<3>();
        let scales = (each(|score| &score.normals) * of(1) + of(0)).exp();
        // The chosen robots stand for all robots of the batch.
        let share = one_in as f64 / robots as f64;
        let value: f64 = scores.iter().map(|score| f64::from(score.value)).sum();
        let torque = of(2);
        let slope: f64 = scores.iter().map(|score| f64::from(score.slope_of_torque)).sum();
        let varies = ((scales.clone() - scales.detach()) * each(|score| &score.slopes)).sum()
            + ((torque.clone() - torque.detach()) * slope).sum();
        (varies + value).unsqueeze::<3>() * share
    }
}

/// The fair continuous ranked probability score of `samples` `[draw, entry]` for the truth `error`,
/// averaged over entries, and its derivative by each sample.
fn fair_crps(samples: &[f32], error: &[f32]) -> (f32, Vec<f32>) {
    let entries = error.len();
    let count = samples.len() / entries;
    let share = 1.0 / entries as f32;
    let [each, pair] = [share / count as f32, share / (count * (count - 1)) as f32];
    let mut slopes = vec![0.0; samples.len()];
    let mut value = 0.0;
    for (entry, error) in error.iter().enumerate() {
        let of_draws = || (0..count).map(|draw| draw * entries + entry);
        for at in of_draws() {
            let sample = samples[at];
            value += each * (sample - error).abs();
            slopes[at] = each * sign(sample - error);
            for other in of_draws() {
                let apart = sample - samples[other];
                value -= 0.5 * pair * apart.abs();
                slopes[at] -= pair * sign(apart);
            }
        }
    }
    (value, slopes)
}

/// The sign of a value; 0 for 0.
fn sign(value: f32) -> f32 {
    if value == 0.0 { 0.0 } else { value.signum() }
}

impl Law {
    /// The score of a robot. `y` are positions of the horizon, and `normals` are the standard
    /// normal numbers of each draw and of its scale.
    fn score(&self, robot: &Recorded<'_>, y: &[f32], normals: &[f32]) -> Score {
        let instructions = InstructionSet::best();
        let (joints, count) = (robot.joints, self.numbers.count());
        let (start, ahead) = y.split_at(2 * joints);
        let u = &robot.u[robot.samples() * joints..];
        let recorded = Recorded { u, y: start, ..*robot };
        let draws = normals.chunks_exact(count + 1 + STRETCH);
        let roll_out = |bounds| {
            let posterior = self.identify(instructions, robot, bounds);
            let residuals = self.residual_torques(instructions, robot, &posterior);
            let drawn: Vec<Vec<f32>> = draws
                .clone()
                .map(|normals| {
                    self.draw_numbers(instructions, robot, &posterior, 1.0, &normals[..count])
                })
                .collect();
            let disturbed: Vec<Vec<f32>> = draws
                .clone()
                .map(|normals| {
                    let mut u = u.to_vec();
                    residuals.add(1.0, &normals[count + 1..], &mut u);
                    u
                })
                .collect();
            let likely = Start { recorded, numbers: &posterior.most_likely.numbers };
            let starts: Vec<Start<'_>> = std::iter::once(likely)
                .chain(drawn.iter().map(|numbers| Start { numbers, ..likely }))
                .chain(
                    disturbed
                        .iter()
                        .map(|u| Start { recorded: Recorded { u, ..recorded }, ..likely }),
                )
                .collect();
            self.roll_out(instructions, &starts)
        };
        let mut answers = roll_out(Bounds::Dissipation);
        let redone = answers.with_too_little_inertia();
        if !redone.is_empty() {
            let without = roll_out(Bounds::DissipationAndMasses);
            redone.into_iter().for_each(|robot| answers.replace(robot, &without, robot));
        }
        let entries = ahead.len();
        let (mean, drawn) = answers.positions.split_at(entries);
        // Draws of numbers made the first half, and draws of torques the second: `[draw, entry]`
        // each.
        let mut differences: Vec<f32> =
            drawn.iter().zip(mean.iter().cycle()).map(|(drawn, mean)| drawn - mean).collect();
        let mut error: Vec<f32> = ahead.iter().zip(mean).map(|(y, mean)| y - mean).collect();
        for (entry, error) in error.iter_mut().enumerate() {
            let each = || (0..2 * DRAWS).map(|draw| draw * entries + entry);
            let squares: f32 = each().map(|at| differences[at] * differences[at]).sum();
            let unit = (squares / DRAWS as f32).sqrt().max(LEAST_DIFFERENCE);
            *error /= unit;
            each().for_each(|at| differences[at] /= unit);
        }
        let normals = draws.map(|normals| normals[count]).collect();
        Score::new(self.calibration, normals, differences.split_at(DRAWS * entries), &error)
    }
}

#[cfg(test)]
mod tests {
    use random::{ChaCha8Rng, SeedableRng};

    use super::{DRAWS, Score, fair_crps};
    use crate::lagrangian::law::Calibration;

    #[test]
    fn the_score_and_its_slopes_are_those_of_the_definition() {
        // Two draws at two samples: 1 and 8, 0 and 1.
        let samples = [1.0, 0.0, 8.0, 1.0];
        let score = |samples: [f32; 4]| fair_crps(&samples, &[2.0, 0.1]);
        let (value, slopes) = score(samples);
        // |1 - 2| and |8 - 2|, less |1 - 8|; |0 - 0.1| and |1 - 0.1|, less |0 - 1|: halves, and their mean.
        assert!((value - 0.5 * (3.5 - 3.5 + 0.5 - 0.5)).abs() < 1e-6, "{value}");
        for at in 0..4 {
            let moved = |by: f32| {
                let mut samples = samples;
                samples[at] += by;
                score(samples).0
            };
            let slope = (moved(0.01) - moved(-0.01)) / 0.02;
            assert!((slopes[at] - slope).abs() < 1e-4, "{slopes:?} {slope}");
        }
    }

    /// The robots differ as the numbers and the torques of their draws do, times a log-normal
    /// scale. Descent must find the scale and the share of the torques.
    #[test]
    fn the_scales_by_which_robots_differ_are_found() {
        const ROBOTS: usize = 10_000;
        let truth = Calibration { log_median: 0.7, log_spread: 0.5, log_torque: -0.4 };
        let mut generator = ChaCha8Rng::seed_from_u64(5);
        let mut normal = |count: usize| {
            let mut values = vec![0.0; count];
            random::fill_normal(&mut values, &mut generator);
            values
        };
        // Numbers change two entries by the first normal, and torques change them by the second.
        let changed = |normals: &[f32]| {
            let each = normals.chunks_exact(2);
            let numbers: Vec<f32> = each.clone().flat_map(|n| [n[0], 0.3 * n[0]]).collect();
            let torques: Vec<f32> = each.flat_map(|n| [0.2 * n[1], 1.5 * n[1]]).collect();
            [numbers, torques]
        };
        let scales = normal(ROBOTS).into_iter().map(|scale| truth.scale(scale));
        let [numbers, torques] = changed(&normal(2 * ROBOTS));
        let errors: Vec<[f32; 2]> = scales
            .zip(numbers.chunks_exact(2).zip(torques.chunks_exact(2)))
            .map(|(scale, (n, t))| {
                [0, 1].map(|entry| scale * (n[entry] + truth.log_torque.exp() * t[entry]))
            })
            .collect();
        let [numbers, torques] = changed(&normal(2 * ROBOTS * DRAWS));
        let normals = normal(ROBOTS * DRAWS);
        let mut calibration = Calibration { log_median: 0.0, log_spread: 0.2, log_torque: 0.0 };
        for _ in 0..200 {
            let mut gradient = [0.0; 3];
            let draws = numbers.chunks_exact(2 * DRAWS).zip(torques.chunks_exact(2 * DRAWS));
            for ((changed, normals), error) in draws.zip(normals.chunks_exact(DRAWS)).zip(&errors) {
                let score = Score::new(calibration, normals.to_vec(), changed, error);
                for (slope, &tail) in score.slopes.iter().zip(normals) {
                    gradient[0] += slope * calibration.scale(tail) / ROBOTS as f32;
                    gradient[1] += slope * calibration.scale(tail) * tail / ROBOTS as f32;
                }
                gradient[2] += score.slope_of_torque / ROBOTS as f32;
            }
            calibration.log_median -= 1.5 * gradient[0];
            calibration.log_spread -= 1.5 * gradient[1];
            calibration.log_torque -= 1.5 * gradient[2];
        }
        assert!((calibration.log_median - truth.log_median).abs() < 0.05, "{calibration:?}");
        assert!((calibration.log_spread - truth.log_spread).abs() < 0.1, "{calibration:?}");
        assert!((calibration.log_torque - truth.log_torque).abs() < 0.1, "{calibration:?}");
    }
}
