//! Tests of drawn robots, and of the masses that they may have.

use burn::tensor::{Device, Tensor, TensorData};
use random::{ChaCha8Rng, SeedableRng};
use series::MeasurementNoise;
use simd::InstructionSet;

use super::{
    CONTEXT, EXACT, JOINT, LONG, Motions, NOISE, Noisy, RATE_HZ, SAMPLES, model, predict, separate,
};
use crate::architecture::ModelInput;
use crate::lagrangian::batch::HostBatch;
use crate::lagrangian::law::{Calibration, JointLaw, Law};
use crate::lagrangian::prediction::smoother_of;
use crate::lagrangian::recorded::Recorded;
use crate::lagrangian::regression::Bounds;
use crate::lagrangian::values;
use crate::randomness::{Noise, Purpose, generator};

/// Standard normal numbers for each of `rows` draws.
fn normals(law: &Law, rows: usize) -> Vec<f32> {
    let mut values = vec![0.0; rows * law.normals_per_draw()];
    random::fill_normal(&mut values, &mut ChaCha8Rng::seed_from_u64(11));
    values
}

#[test]
fn draws_have_the_same_bits_on_every_processor_and_in_every_company() {
    let law = Law {
        calibration: Calibration { log_median: 0.3, log_spread: 0.4, log_torque: 0.2 },
        ..model(7).law()
    };
    let motions = Motions::new(3, 7);
    let robots: Vec<Recorded<'_>> =
        motions.robots().into_iter().flat_map(|robot| [robot; 4]).collect();
    let normals = normals(&law, robots.len());
    let draws: Vec<&[f32]> = normals.chunks_exact(law.normals_per_draw()).collect();
    for noise in [EXACT, NOISE] {
        let together = law.predict(InstructionSet::best(), &robots, noise, &draws, 0);
        for instructions in InstructionSet::available() {
            assert_eq!(law.predict(instructions, &robots, noise, &draws, 0), together);
        }
        let answers: Vec<&[f32]> = together.chunks_exact((SAMPLES - CONTEXT) * 7).collect();
        for ((robot, draw), answer) in robots.iter().zip(&draws).zip(&answers) {
            let alone = law.predict(InstructionSet::best(), &[*robot], noise, &[*draw], 0);
            assert_eq!(alone, *answer);
        }
        assert!(answers[0] != answers[1], "two draws of one robot are the same");
    }
}

/// Mean and standard deviation of each joint at the last sample of the horizon, over `count` draws of one robot.
fn spread(law: &Law, robot: &Recorded<'_>, noise: MeasurementNoise, count: usize) -> Vec<[f64; 2]> {
    let normals = normals(law, count);
    let draws: Vec<&[f32]> = normals.chunks_exact(law.normals_per_draw()).collect();
    let robots = vec![*robot; count];
    let answers = law.predict(InstructionSet::best(), &robots, noise, &draws, 0);
    let horizon = answers.len() / count;
    let of_joint = |joint: usize| {
        let last = horizon - robot.joints + joint;
        let values: Vec<f64> =
            answers.chunks_exact(horizon).map(|answer| f64::from(answer[last])).collect();
        let mean = values.iter().sum::<f64>() / count as f64;
        let squares = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        [mean, (squares / count as f64).sqrt()]
    };
    (0..robot.joints).map(of_joint).collect()
}

#[test]
fn draws_lie_around_the_most_likely_robot_and_closer_the_more_was_seen() {
    let robot = Noisy::new(3);
    let law = &robot.law;
    let seen = |context: usize, noise| {
        let y: Vec<f32> = match noise {
            EXACT => robot.truth[..context * 2].to_vec(),
            _ => robot.measured[..context * 2].to_vec(),
        };
        let recorded = Recorded { u: &robot.u[..(context + 60) * 2], y: &y, ..robot.robot() };
        let likely = predict(law, &[recorded], noise);
        let likely = &likely[likely.len() - 2..];
        let found = spread(law, &recorded, noise, 400);
        for ([mean, deviation], likely) in found.iter().zip(likely) {
            let off = (mean - f64::from(*likely)).abs();
            assert!(off < 0.3 * deviation + 1e-6, "{context}: {found:?} {likely}");
        }
        found.iter().map(|[_, deviation]| *deviation).sum::<f64>()
    };
    let [nothing, little, much] = [2, 12, LONG].map(|context| seen(context, EXACT));
    assert!(nothing > 10.0 * little && little > 2.0 * much, "{nothing} {little} {much}");
    // The position and the velocity at the end of the context are uncertain, too.
    assert!(seen(LONG, NOISE) > 2.0 * much);
}

#[test]
fn a_larger_scale_widens_draws() {
    let robot = Noisy::new(4);
    let recorded = Recorded { y: &robot.truth[..40 * 2], u: &robot.u[..100 * 2], ..robot.robot() };
    let width = |calibration| {
        let law = Law { calibration, ..separate(&[1.2, 0.02], JOINT, [10.0, 1.0]) };
        spread(&law, &recorded, EXACT, 400).iter().map(|[_, deviation]| *deviation).sum::<f64>()
    };
    let plain = width(Calibration { log_median: 0.0, log_spread: 0.0, log_torque: 0.0 });
    let twice = width(Calibration { log_median: 2_f32.ln(), log_spread: 0.0, log_torque: 0.0 });
    assert!((twice / plain - 2.0).abs() < 0.1, "{plain} {twice}");
    assert!(width(Calibration { log_median: 0.0, log_spread: 0.8, log_torque: 0.0 }) > 1.3 * plain);
}

/// The law does not know a slow torque at the second joint. Draws must differ more there, in
/// proportion to the torque of the context.
#[test]
fn draws_have_the_residual_torques_of_the_law() {
    let robot = Noisy::new(5);
    let calibration = Calibration { log_median: 0.0, log_spread: 0.0, log_torque: 0.0 };
    let width = |amplitude: f32, log_torque: f32| {
        let mut u = robot.u.clone();
        // It was recorded as a torque of the motor, but it moved nothing.
        for sample in 0..LONG {
            u[sample * 2 + 1] += amplitude * (0.05 * sample as f32).cos();
        }
        let recorded = Recorded { u: &u, y: &robot.truth[..LONG * 2], ..robot.robot() };
        let mut law = Law {
            calibration: Calibration { log_torque, ..calibration },
            ..separate(&[1.2, 0.02], JOINT, [10.0, 1.0])
        };
        law.prior.spread.fill(1e-6);
        law.prior.mean[law.numbers.dampings()].copy_from_slice(&[9.0, 11.5]);
        let found = spread(&law, &recorded, EXACT, 300);
        found.iter().map(|[_, deviation]| *deviation).collect::<Vec<_>>()
    };
    let [none, some, twice] = [0.0, 0.1, 0.2].map(|amplitude| width(amplitude, 0.0));
    assert!(some[1] > 100.0 * none[1] && some[0] < 2.0 * none[0], "{none:?} {some:?}");
    assert!((twice[1] / some[1] - 2.0).abs() < 0.05, "{some:?} {twice:?}");
    let wider = width(0.1, 2_f32.ln());
    assert!((wider[1] / twice[1] - 1.0).abs() < 0.05, "{wider:?} {twice:?}");
}

/// Smoothing leaves torques of noisy positions that move nothing. Only what the law does not explain goes
/// on over a horizon.
#[test]
fn residual_torques_do_not_contain_what_smoothing_leaves_of_the_noise() {
    let robot = Noisy::new(6);
    let size = |u: &[f32], noise: MeasurementNoise| {
        let y = if noise == EXACT { &robot.truth[..LONG * 2] } else { &robot.measured[..] };
        let recorded = Recorded { u, y, ..robot.robot() };
        let smoother = smoother_of(&recorded, noise);
        let filter = smoother.as_ref().map(|smoother| (smoother, noise));
        let instructions = InstructionSet::best();
        let mut posterior =
            robot.law.posterior(instructions, &recorded, filter, Bounds::Dissipation);
        let mut of_second = || {
            let residuals = robot.law.residual_torques(instructions, &recorded, &posterior);
            if let Some(filtered) = &mut posterior.filtered {
                filtered.law_errors.fill(f32::MAX);
            }
            let torques = residuals.torques.iter().skip(1).step_by(2);
            (torques.map(|torque| torque * torque).sum::<f32>() * 2.0
                / residuals.torques.len() as f32)
                .sqrt()
        };
        [of_second(), of_second()]
    };
    // The law is exact, so all that is left comes from the noise.
    let [kept, left] = size(&robot.u, NOISE);
    assert!(kept < 0.5 * left, "{kept} {left}");
    // A torque that was recorded but moved nothing.
    let mut u = robot.u.clone();
    for sample in 0..LONG {
        u[sample * 2 + 1] += 0.5 * (0.2 * sample as f32).cos();
    }
    let [truth, _] = size(&u, EXACT);
    let [kept, left] = size(&u, NOISE);
    assert!(kept > 0.7 * truth && kept <= left, "{kept} {left} {truth}");
}

/// The joint's inertia is below the one that the law gives every robot, so its particle would have
/// a negative mass.
#[test]
fn masses_are_negative_only_where_poses_keep_their_inertia() {
    let joint = JointLaw { armature: 0.5, ..JOINT };
    let mut law = separate(&[0.7], joint, [3.0, 0.5]);
    law.prior.spread[0] = 5.0;
    let u: Vec<f32> = (0..SAMPLES).map(|index| 4.0 * (0.11 * index as f32).sin()).collect();
    for (inertia, expected) in [(0.6_f32, 0.5), (0.3, 0.0)] {
        let (mass, damping) = (inertia * RATE_HZ, 3.0);
        let mut y = vec![0.0_f32; CONTEXT];
        let mut velocity = 0.0;
        for sample in 1..CONTEXT {
            velocity = (u[sample - 1] + mass * velocity) / (mass + damping);
            y[sample] = y[sample - 1] + velocity / RATE_HZ;
        }
        let robot = Recorded { u: &u, y: &y, joints: 1, rate_hz: RATE_HZ };
        let found = law.fit(InstructionSet::best(), &robot, Bounds::Dissipation).mean[0];
        assert!((found - expected).abs() < 0.05, "{inertia}: {found}");
        for [mean, deviation] in spread(&law, &robot, EXACT, 50) {
            assert!(mean.is_finite() && deviation.is_finite() && deviation < 1.0, "{deviation}");
        }
    }
}

/// Regression: a law of 100 points scored one robot in a hundred, which were too few in short
/// trainings to know the spread of draws.
#[test]
fn one_robot_of_twelve_is_scored_however_many_points_there_are() {
    const STEPS: u64 = 300;
    let joints = 2;
    let scored = |robots: usize| {
        let motions = Motions::new(robots, joints);
        let tensor = |values: &[f32], samples: usize| {
            let data = TensorData::new(values.to_vec(), [robots, samples, joints]);
            Tensor::<3>::from_data(data, &Device::flex())
        };
        let [u, y] = [tensor(&motions.u, SAMPLES), tensor(&motions.y, CONTEXT)];
        let batch = HostBatch::new(&ModelInput {
            u: u.clone(),
            y_context: y.clone(),
            seen_context: y.clone(),
            path: u.clone(),
            unit: u,
            rate_hz: f64::from(RATE_HZ),
            measurement_noise: EXACT,
        });
        let target = y.slice([0..robots, 0..SAMPLES - CONTEXT, 0..joints]);
        let model = model(joints);
        assert!(model.points > 12);
        let steps = (0..STEPS).filter(|step| {
            let rows = 0..robots as u64;
            let rows = rows.map(|row| generator(1, Purpose::Training, *step, row));
            values(model.score(&batch, target.clone(), &mut Noise::new(rows))) != [0.0]
        });
        steps.count()
    };
    // None is chosen in (11/12)ⁿ of the steps. Four standard deviations.
    assert!(scored(1).abs_diff(25) < 20, "{}", scored(1));
    assert!(scored(8).abs_diff(150) < 35, "{}", scored(8));
}
