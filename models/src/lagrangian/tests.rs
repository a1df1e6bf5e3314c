#![expect(clippy::cast_possible_truncation, reason = "small numbers")]

use burn::tensor::Device;
use random::{ChaCha8Rng, Rng, SeedableRng};
use series::MeasurementNoise;
use simd::InstructionSet;
use spec::LagrangianSpec;

use super::dense::Dense;
use super::fit::Prior;
use super::law::Law;
use super::motion::{Recorded, products};
use super::points::Points;
use super::{LEAST_INERTIA, Lagrangian, values};
use crate::architecture::{Architecture, Extents};
use crate::initialization::InitialWeights;

const CONTEXT: usize = 60;
const SAMPLES: usize = 90;
const RATE_HZ: f32 = 60.0;

fn spec() -> LagrangianSpec {
    LagrangianSpec { width: 20, layers: 2, points: 24, turns_freely: true }
}

fn model(joints: usize) -> Lagrangian {
    let device = Device::flex();
    let mut weights = InitialWeights::new(3, &device);
    let extents = Extents::new(CONTEXT as u32, SAMPLES as u32, joints).unwrap();
    spec().init(extents, &mut weights).unwrap()
}

/// Smooth torques and positions of a few robots, one after the other.
struct Motions {
    u: Vec<f32>,
    y: Vec<f32>,
    joints: usize,
}

impl Motions {
    fn new(robots: usize, joints: usize) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(robots as u64);
        let mut unit = move || generator.next_u32() as f32 / u32::MAX as f32;
        let mut wave = |samples: usize| {
            let mut series = vec![0.0; robots * samples * joints];
            for robot in series.chunks_exact_mut(samples * joints) {
                for joint in 0..joints {
                    let [amplitude, rate, phase] = [(); 3].map(|()| unit());
                    for sample in 0..samples {
                        let angle = 6.0 * phase + 0.1 * rate * sample as f32;
                        robot[sample * joints + joint] = amplitude * angle.sin();
                    }
                }
            }
            series
        };
        Self { u: wave(SAMPLES), y: wave(CONTEXT), joints }
    }

    fn robots(&self) -> Vec<Recorded<'_>> {
        let torques = self.u.chunks_exact(SAMPLES * self.joints);
        let positions = self.y.chunks_exact(CONTEXT * self.joints);
        let recorded = |(u, y)| Recorded { u, y, joints: self.joints, rate_hz: RATE_HZ };
        torques.zip(positions).map(recorded).collect()
    }
}

#[test]
fn a_prediction_has_the_same_bits_on_every_processor_and_in_every_company() {
    for joints in [2, 6, 7, 8] {
        let law = model(joints).law();
        let motions = Motions::new(37, joints);
        let robots = motions.robots();
        let together = law.predict(&robots);
        // Nothing was learned: some of these laws drive joints on and on.
        assert!(together.iter().all(|position| position.is_finite()));
        for instructions in InstructionSet::available() {
            assert_eq!(law.predict_with(instructions, &robots), together, "{instructions}");
        }
        for (robot, answer) in
            robots.iter().zip(together.chunks_exact((SAMPLES - CONTEXT) * joints))
        {
            assert_eq!(law.predict(&[*robot]), answer);
        }
    }
}

/// A planner asks for many torques after one past; the first of them is that at the last position.
#[test]
fn questions_of_one_past_are_one_robot_and_have_the_answers_of_each_alone() {
    let law = model(7).law();
    let motions = Motions::new(5, 7);
    let robots = motions.robots();
    let mut planned = robots[1].u.to_vec();
    planned[(CONTEXT - 1) * 7] += 1.0;
    let mut other = robots[1].u.to_vec();
    other[(CONTEXT - 2) * 7] += 1.0;
    let with = |u| Recorded { u, ..robots[1] };
    assert!(with(&planned[..]).has_the_past_of(&robots[1]));
    assert!(!with(&other[..]).has_the_past_of(&robots[1]));
    assert!(!robots[0].has_the_past_of(&robots[1]));
    let asked = [robots[0], robots[1], with(&planned), with(&other), robots[1]];
    let answers = law.predict(&asked);
    for (robot, answer) in asked.iter().zip(answers.chunks_exact((SAMPLES - CONTEXT) * 7)) {
        assert_eq!(law.predict(&[*robot]), answer);
    }
}

#[test]
fn what_predicts_fits_the_dampings_that_training_fits() {
    for joints in [2, 7] {
        let model = model(joints);
        let motions = Motions::new(3, joints);
        let robots = motions.robots();
        let mut points = Points::new([robots.len(), joints, CONTEXT - 2]);
        for robot in &robots {
            for sample in 1..CONTEXT - 1 {
                points.push(robot, sample, model.first);
            }
        }
        let device = Device::flex();
        let inertial = model.inertial(
            points.pose(&device),
            points.acceleration(&device),
            points.products(&device),
        );
        let fitted = points.fit(&values(inertial), &model.priors());
        let expected = values(fitted.damping(joints, &device));
        let found = model.law().dampings(InstructionSet::best(), &robots);
        for (found, expected) in found.iter().zip(expected.chunks_exact(joints)) {
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-4 * (1.0 + expected), "{found} {expected}");
            }
        }
    }
}

/// Joints that do not feel each other: m (v' - v) / h + d v' = u.
fn separate(masses: &[f32], priors: Vec<Prior>) -> Law {
    let joints = masses.len();
    let mut bias = vec![0.0; joints * (joints + products(joints))];
    for (joint, mass) in masses.iter().enumerate() {
        bias[joint * (joints + 1)] = (mass - LEAST_INERTIA).sqrt();
    }
    let weight = vec![0.0; bias.len() * 2 * joints];
    Law::new(vec![Dense::new(&weight, &bias)], priors, 0, LEAST_INERTIA)
}

#[test]
fn dampings_are_found_and_the_horizon_follows() {
    let (masses, dampings) = ([0.5, 0.02], [9.0, 11.5]);
    let prior = Prior { share: 1.0, mean: 10.0, spread: 1.0, noise: 1e-3 };
    let u: Vec<f32> = (0..SAMPLES * 2).map(|index| 4.0 * (0.11 * index as f32).sin()).collect();
    let mut y = vec![0.0_f32; SAMPLES * 2];
    let mut velocity = [0.0_f64; 2];
    for sample in 1..SAMPLES {
        for joint in 0..2 {
            let [mass, damping] = [masses[joint] * RATE_HZ, dampings[joint]].map(f64::from);
            let torque = f64::from(u[(sample - 1) * 2 + joint]);
            velocity[joint] = (torque + mass * velocity[joint]) / (mass + damping);
            y[sample * 2 + joint] =
                y[(sample - 1) * 2 + joint] + (velocity[joint] / f64::from(RATE_HZ)) as f32;
        }
    }
    let law = separate(&masses, vec![prior; 2]);
    let robot = Recorded { u: &u, y: &y[..CONTEXT * 2], joints: 2, rate_hz: RATE_HZ };
    let found = law.dampings(InstructionSet::best(), &[robot]);
    for joint in 0..2 {
        assert!((found[0][joint] - dampings[joint]).abs() < 1e-2, "{:?}", found[0]);
    }
    for (predicted, expected) in law.predict(&[robot]).iter().zip(&y[CONTEXT * 2..]) {
        assert!((predicted - expected).abs() < 1e-4, "{predicted} {expected}");
    }
}

#[test]
fn a_robot_that_stands_still_or_was_hardly_seen_has_the_mean_damping() {
    let prior = Prior { share: 0.7, mean: 3.0, spread: 0.5, noise: 0.1 };
    let law = separate(&[0.2; 3], vec![prior; 3]);
    let u = vec![1.0; 40 * 3];
    for context in [1, 2, 3, 30] {
        let y = vec![0.4; context * 3];
        let robot = Recorded { u: &u, y: &y, joints: 3, rate_hz: RATE_HZ };
        let found = law.dampings(InstructionSet::best(), &[robot]);
        assert_eq!(found[0][..3], [3.0; 3]);
        let answer = law.predict(&[robot]);
        assert_eq!(answer.len(), (40 - context) * 3);
        assert!(answer.iter().all(|value| value.is_finite()));
    }
}

/// Joints that do not feel each other, moved by waves, and their positions with noise of 1 mrad.
struct Noisy {
    law: Law,
    u: Vec<f32>,
    truth: Vec<f32>,
    measured: Vec<f32>,
}

const NOISE: MeasurementNoise = MeasurementNoise { position_rad: 1e-3, torque_nm: 0.0 };
const LONG: usize = 320;

impl Noisy {
    fn new(seed: u64) -> Self {
        let (masses, dampings) = ([1.2, 0.02], [9.0, 11.5]);
        let prior = Prior { share: 1.0, mean: 10.0, spread: 1.0, noise: 1e-3 };
        let samples = LONG + SAMPLES;
        let u: Vec<f32> = (0..samples * 2).map(|index| 4.0 * (0.03 * index as f32).sin()).collect();
        let mut truth = vec![0.0_f32; samples * 2];
        let mut velocity = [0.0_f64; 2];
        for sample in 1..samples {
            for joint in 0..2 {
                let [mass, damping] = [masses[joint] * RATE_HZ, dampings[joint]].map(f64::from);
                let torque = f64::from(u[(sample - 1) * 2 + joint]);
                velocity[joint] = (torque + mass * velocity[joint]) / (mass + damping);
                truth[sample * 2 + joint] =
                    truth[(sample - 1) * 2 + joint] + (velocity[joint] / f64::from(RATE_HZ)) as f32;
            }
        }
        let mut noise = vec![0.0; LONG * 2];
        random::fill_normal_portably(&mut noise, &mut ChaCha8Rng::seed_from_u64(seed));
        let measured =
            truth.iter().zip(noise).map(|(q, n)| q + (NOISE.position_rad * n) as f32).collect();
        Self { law: separate(&masses, vec![prior; 2]), u, truth, measured }
    }

    fn robot(&self) -> Recorded<'_> {
        Recorded { u: &self.u, y: &self.measured, joints: 2, rate_hz: RATE_HZ }
    }

    /// Root mean square over the horizon, rad.
    fn error(&self, predicted: &[f32]) -> f64 {
        let truth = &self.truth[LONG * 2..];
        assert_eq!(predicted.len(), truth.len());
        let squares = predicted.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2));
        (squares.sum::<f64>() / truth.len() as f64).sqrt()
    }
}

#[test]
fn a_filter_that_knows_the_noise_predicts_well_below_it() {
    let (mut filtered, mut raw) = (0.0, 0.0);
    for seed in 0..8 {
        let robot = Noisy::new(seed);
        filtered += robot.error(&robot.law.predict_noisy(&[robot.robot()], NOISE)) / 8.0;
        raw += robot.error(&robot.law.predict(&[robot.robot()])) / 8.0;
    }
    assert!(filtered < 0.4 * NOISE.position_rad, "{filtered}");
    assert!(raw > 10.0 * filtered, "{raw} {filtered}");
}

#[test]
fn without_noise_a_prediction_is_not_filtered() {
    let law = model(7).law();
    let motions = Motions::new(5, 7);
    let robots = motions.robots();
    let none = MeasurementNoise { position_rad: 0.0, torque_nm: 0.3 };
    assert_eq!(law.predict_noisy(&robots, none), law.predict(&robots));
}

#[test]
fn filtered_predictions_have_the_same_bits_in_every_company() {
    for joints in [2, 7] {
        let law = model(joints).law();
        let motions = Motions::new(7, joints);
        let mut robots = motions.robots();
        let mut planned = robots[1].u.to_vec();
        planned[(CONTEXT - 1) * joints..].fill(0.5);
        robots.insert(2, Recorded { u: &planned, ..robots[1] });
        let together = law.predict_noisy(&robots, NOISE);
        assert!(together.iter().all(|position| position.is_finite()));
        let answers = together.chunks_exact((SAMPLES - CONTEXT) * joints);
        for (robot, answer) in robots.iter().zip(answers) {
            assert_eq!(law.predict_noisy(&[*robot], NOISE), answer);
        }
    }
}

#[test]
fn a_context_too_short_or_still_to_filter_has_a_finite_answer() {
    let prior = Prior { share: 0.7, mean: 3.0, spread: 0.5, noise: 0.1 };
    let law = separate(&[0.2; 3], vec![prior; 3]);
    let u = vec![0.0; 40 * 3];
    for context in [1, 2, 3, 8, 30] {
        for position_rad in [1e-9, 1e-3, 0.1] {
            let y = vec![0.4; context * 3];
            let robot = Recorded { u: &u, y: &y, joints: 3, rate_hz: RATE_HZ };
            let noise = MeasurementNoise { position_rad, torque_nm: 0.0 };
            let answer = law.predict_noisy(&[robot], noise);
            assert_eq!(answer.len(), (40 - context) * 3);
            assert!(answer.iter().all(|value| (value - 0.4).abs() < 1e-3), "{answer:?}");
        }
    }
}
