//! Tests of the learned equations of motion.

#![expect(clippy::cast_possible_truncation, reason = "small numbers")]

use burn::module::Param;
use burn::tensor::{Device, Tensor, TensorData};
use random::{ChaCha8Rng, Rng, SeedableRng};
use series::{JointMotion, MeasurementNoise};
use simd::InstructionSet;
use spec::LagrangianSpec;

use super::batch::Points;
use super::features::Samples;
use super::law::{Calibration, DIRECTIONS, JointLaw, Law, Limits, Network, Places};
use super::linear_algebra::Dense;
use super::recorded::Recorded;
use super::regression::{Bounds, Numbers, Prior};
use super::{Lagrangian, PACE, values};
use crate::architecture::{Architecture, Extents};
use crate::initialization::InitialWeights;

mod chain;
mod draws;
mod paths;
mod told;

const CONTEXT: usize = 60;
const SAMPLES: usize = 90;
const RATE_HZ: f32 = 60.0;

fn spec() -> LagrangianSpec {
    LagrangianSpec {
        width: 20,
        layers: 2,
        points: 24,
        particles: 5,
        forces: 3,
        turns_freely: true,
        robot: None,
        chain: None,
        rotor_inertia: false,
        torque_offset: false,
        disturbance: false,
    }
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

const EXACT: MeasurementNoise = MeasurementNoise::new(0.0, 0.0);

/// Predictions of the most likely robots.
fn predict(law: &Law, robots: &[Recorded<'_>], noise: MeasurementNoise) -> Vec<f32> {
    law.predict(InstructionSet::best(), robots, noise, &[], 0)
}

#[test]
fn a_prediction_has_the_same_bits_on_every_processor_and_in_every_company() {
    for joints in [2, 6, 7, 8] {
        let law = model(joints).law();
        let motions = Motions::new(37, joints);
        let robots = motions.robots();
        let together = predict(&law, &robots, EXACT);
        // These laws are untrained, and some of them accelerate joints without end.
        assert!(together.iter().all(|position| position.is_finite()));
        for instructions in InstructionSet::available() {
            assert_eq!(
                law.predict(instructions, &robots, EXACT, &[], 0),
                together,
                "{instructions}"
            );
        }
        for (robot, answer) in
            robots.iter().zip(together.chunks_exact((SAMPLES - CONTEXT) * joints))
        {
            assert_eq!(predict(&law, &[*robot], EXACT), answer);
        }
    }
}

/// A planner asks for many torques after one past. The first of them is the torque at the last
/// position.
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
    let answers = predict(&law, &asked, EXACT);
    for (robot, answer) in asked.iter().zip(answers.chunks_exact((SAMPLES - CONTEXT) * 7)) {
        assert_eq!(predict(&law, &[*robot], EXACT), answer);
    }
}

#[test]
fn prediction_fits_the_numbers_that_training_fits() {
    for joints in [2, 7] {
        let mut model = model(joints);
        // The noise is so large that no number of these robots reaches its bound. Training does not
        // know bounds.
        model.noise = Param::from_tensor(model.noise.val().ones_like() * (30_f32.ln() / PACE));
        model.friction = Param::from_tensor(model.friction.val().ones_like() / PACE);
        let motions = Motions::new(3, joints);
        let robots = motions.robots();
        let points = every_point(&model, &robots);
        let [factors, torques] = model.equations(&points, &Device::flex()).map(values);
        let prior = model.prior();
        let fitted = points.fit(&factors, &torques, &model.joint_laws(), &prior, model.numbers);
        let law = Law { points: CONTEXT, ..model.law() };
        for (robot, expected) in robots.iter().zip(fitted.mean.chunks_exact(model.numbers.count()))
        {
            let found = law.fit(InstructionSet::best(), robot, Bounds::Dissipation).mean;
            let each = found.iter().zip(expected).zip(&prior.mean);
            for (number, ((found, expected), &mean)) in each.enumerate() {
                assert!(
                    !model.numbers.is_bounded(number, Bounds::Dissipation) || *expected > 0.0,
                    "{expected}"
                );
                let learned = (f64::from(*expected) - mean).abs();
                let off = (found - f64::from(*expected)).abs();
                assert!(off < 1e-3 * learned + 1e-5, "{number}: {found} {expected} {mean}");
            }
        }
    }
}

fn every_point(model: &Lagrangian, robots: &[Recorded<'_>]) -> Points {
    let joints = model.numbers.joints;
    let mut points = Points::new([robots.len(), joints, CONTEXT - 2], model.first);
    for robot in robots {
        for sample in 1..CONTEXT - 1 {
            points.push(robot, sample);
        }
    }
    points
}

/// The torques of each particle of mass 1 that training computes, `[particle, joint]`.
fn particle_torques(model: &Lagrangian, q: &[f32], v: &[f32], a: &[f32]) -> Vec<f32> {
    let device = Device::flex();
    let joints = q.len();
    let seen = || q.iter().zip(v).skip(model.first);
    let pose = seen().map(|(q, _)| q.sin()).chain(seen().map(|(q, _)| q.cos()));
    let rate = seen().map(|(q, v)| q.cos() * v).chain(seen().map(|(q, v)| -q.sin() * v));
    let tensor = |values: Vec<f32>| {
        let shape = [1, 1, values.len()];
        Tensor::from_data(TensorData::new(values, shape), &device)
    };
    let turning = if model.first == 0 { 0.0 } else { v[0] };
    assert_eq!(a.len(), joints);
    let [particles_and_forces, _] = model.features(Samples {
        pose: tensor(pose.collect()),
        rate: tensor(rate.collect()),
        velocity: tensor(v.to_vec()),
        acceleration: tensor(a.to_vec()),
        turning: tensor(vec![turning]),
    });
    let particles = particles_and_forces.narrow(2, 0, model.numbers.particles);
    values(particles.swap_dims(1, 2))
}

/// The energy of a particle of mass 1 is half its velocity squared. It grows by the joints' power,
/// dE/dt = v · τ, whatever its Jacobian is.
#[test]
fn a_particle_gains_the_energy_that_the_joints_give_it() {
    for turns_freely in [true, false] {
        let spec = LagrangianSpec { turns_freely, ..spec() };
        let device = Device::flex();
        let mut weights = InitialWeights::new(5, &device);
        let extents = Extents::new(CONTEXT as u32, SAMPLES as u32, 4).unwrap();
        let model = spec.init(extents, &mut weights).unwrap();
        let (q, v, a) = ([0.3, -0.7, 1.1, 0.2], [0.8, -1.2, 0.5, 0.9], [2.0, 1.0, -3.0, 0.5]);
        let power = |torques: &[f32], v: &[f32]| -> f64 {
            torques.iter().zip(v).map(|(torque, v)| f64::from(torque * v)).sum()
        };
        // At rest and with the acceleration v, a particle needs the torques M v.
        let energies = |step: f32| -> Vec<f64> {
            let after = |x: &[f32; 4], rate: &[f32; 4]| -> Vec<f32> {
                x.iter().zip(rate).map(|(x, rate)| x + step * rate).collect()
            };
            let (q, v) = (after(&q, &v), after(&v, &a));
            let torques = particle_torques(&model, &q, &[0.0; 4], &v);
            torques.chunks_exact(4).map(|torques| 0.5 * power(torques, &v)).collect()
        };
        let step = 4e-3;
        let torques = particle_torques(&model, &q, &v, &a);
        let around = energies(step).into_iter().zip(energies(-step));
        for ((after, before), torques) in around.zip(torques.chunks_exact(4)) {
            let gained = (after - before) / f64::from(2.0 * step);
            let power = power(torques, &v);
            assert!((gained - power).abs() < 1e-3 * (1.0 + power.abs()), "{gained} {power}");
        }
    }
}

/// Uncoupled joints: m (v' - v) / h + d v' = u. Each has a particle of its own.
fn separate(masses: &[f32], joint: JointLaw, damping: [f64; 2]) -> Law {
    let joints = masses.len();
    let numbers = Numbers {
        particles: joints,
        forces: 0,
        joints,
        moments: false,
        rotors: false,
        offsets: false,
    };
    let mut bias = vec![0.0; DIRECTIONS * joints * joints];
    for (particle, mass) in masses.iter().enumerate() {
        bias[particle * (joints + 1)] = (mass - joint.armature).sqrt();
    }
    let weight = vec![0.0; bias.len() * 2 * joints];
    let [mean, spread] = damping;
    let mut prior = Prior { mean: vec![1.0; joints], spread: vec![1e-6; numbers.count()] };
    prior.mean.extend(vec![mean; joints]);
    prior.mean.extend(vec![0.0; joints]);
    prior.spread[numbers.dampings()].fill(spread);
    Law {
        places: Places::Learned(Network {
            hidden: Vec::new(),
            particles: Dense::new(&weight, &bias),
            forces: None,
            first: 0,
        }),
        joints: vec![joint; joints],
        prior,
        calibration: Calibration { log_median: 0.0, log_spread: 0.0, log_torque: 0.0 },
        numbers,
        disturbance: false,
        points: 1000,
    }
}

const JOINT: JointLaw = JointLaw {
    share: 1.0,
    armature: 1e-3,
    noise: 1e-3,
    friction_slope: 4.0,
    friction_shift: 0.0,
    limits: Limits::UNKNOWN,
};

#[test]
fn dampings_are_found_and_the_horizon_follows() {
    let (masses, dampings) = ([0.5, 0.02], [9.0, 11.5]);
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
    let law = separate(&masses, JOINT, [10.0, 1.0]);
    let robot = Recorded { u: &u, y: &y[..CONTEXT * 2], joints: 2, rate_hz: RATE_HZ };
    let found = law.fit(InstructionSet::best(), &robot, Bounds::Dissipation).mean;
    let found = &found[law.numbers.dampings()];
    for joint in 0..2 {
        assert!((found[joint] - f64::from(dampings[joint])).abs() < 1e-2, "{found:?}");
    }
    for (predicted, expected) in predict(&law, &[robot], EXACT).iter().zip(&y[CONTEXT * 2..]) {
        assert!((predicted - expected).abs() < 1e-4, "{predicted} {expected}");
    }
}

#[test]
fn a_robot_that_stands_still_or_was_hardly_seen_has_the_mean_damping() {
    let law = separate(&[0.2; 3], JointLaw { share: 0.7, noise: 0.1, ..JOINT }, [3.0, 0.5]);
    let u = vec![1.0; 40 * 3];
    for context in [1, 2, 3, 30] {
        let y = vec![0.4; context * 3];
        let robot = Recorded { u: &u, y: &y, joints: 3, rate_hz: RATE_HZ };
        let found = law.fit(InstructionSet::best(), &robot, Bounds::Dissipation).mean;
        assert_eq!(found[law.numbers.dampings()], [3.0; 3]);
        let answer = predict(&law, &[robot], EXACT);
        assert_eq!(answer.len(), (40 - context) * 3);
        assert!(answer.iter().all(|value| value.is_finite()));
    }
}

/// Uncoupled joints that waves move, and their positions with noise of 1 mrad.
struct Noisy {
    law: Law,
    u: Vec<f32>,
    truth: Vec<f32>,
    measured: Vec<f32>,
}

const NOISE: MeasurementNoise = MeasurementNoise::new(1e-3, 0.0);
const LONG: usize = 320;

impl Noisy {
    fn new(seed: u64) -> Self {
        let (masses, dampings) = ([1.2, 0.02], [9.0, 11.5]);
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
        Self { law: separate(&masses, JOINT, [10.0, 1.0]), u, truth, measured }
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
        filtered += robot.error(&predict(&robot.law, &[robot.robot()], NOISE)) / 8.0;
        raw += robot.error(&predict(&robot.law, &[robot.robot()], EXACT)) / 8.0;
    }
    assert!(filtered < 0.4 * NOISE.position_rad, "{filtered}");
    assert!(raw > 10.0 * filtered, "{raw} {filtered}");
}

#[test]
fn without_noise_a_prediction_is_not_filtered() {
    let law = model(7).law();
    let motions = Motions::new(5, 7);
    let robots = motions.robots();
    let none = MeasurementNoise::new(0.0, 0.3);
    assert_eq!(predict(&law, &robots, none), predict(&law, &robots, EXACT));
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
        let together = predict(&law, &robots, NOISE);
        assert!(together.iter().all(|position| position.is_finite()));
        let answers = together.chunks_exact((SAMPLES - CONTEXT) * joints);
        for (robot, answer) in robots.iter().zip(answers) {
            assert_eq!(predict(&law, &[*robot], NOISE), answer);
        }
    }
}

#[test]
fn a_context_too_short_or_still_to_filter_has_a_finite_answer() {
    let law = separate(&[0.2; 3], JointLaw { share: 0.7, noise: 0.1, ..JOINT }, [3.0, 0.5]);
    let u = vec![0.0; 40 * 3];
    for context in [1, 2, 3, 8, 30] {
        for position_rad in [1e-9, 1e-3, 0.1] {
            let y = vec![0.4; context * 3];
            let robot = Recorded { u: &u, y: &y, joints: 3, rate_hz: RATE_HZ };
            let noise = MeasurementNoise::new(position_rad, 0.0);
            let answer = predict(&law, &[robot], noise);
            assert_eq!(answer.len(), (40 - context) * 3);
            assert!(answer.iter().all(|value| (value - 0.4).abs() < 1e-3), "{answer:?}");
        }
    }
}

/// The equations of the context say how far its torques are from those that the law takes.
#[test]
fn the_torques_of_a_motion_are_those_of_the_equations_on_every_processor() {
    for joints in [2, 7] {
        let mut law = model(joints).law();
        law.joints.iter_mut().for_each(|joint| joint.share = 0.5);
        let motions = Motions::new(3, joints);
        let robots = motions.robots();
        let measured: Vec<JointMotion> = robots
            .iter()
            .map(|robot| JointMotion::measured(robot.y, joints, f64::from(RATE_HZ)))
            .collect();
        let best = InstructionSet::best();
        let torques = |instructions: InstructionSet| -> Vec<Vec<f32>> {
            let fitted = law.most_likely(instructions, &robots, EXACT);
            let each = fitted.iter().zip(&measured);
            each.map(|(numbers, motion)| law.torques(instructions, numbers, motion)).collect()
        };
        let said = torques(best);
        for instructions in InstructionSet::available() {
            assert_eq!(torques(instructions), said);
        }
        for (robot, said) in robots.iter().zip(&said) {
            let fitted = law.identify(best, robot, Bounds::Dissipation).numbers;
            let equations = law.equations_of(best, robot);
            let rows = equations.of(0..equations.samples());
            assert_eq!(said.len(), (CONTEXT - 2) * joints);
            for (row, (equation, said)) in rows.zip(said).enumerate() {
                let (sample, joint) = (1 + row / joints, row % joints);
                let acted = robot.motion(sample, joint).torque_at(0.5);
                let expected = acted - equation.residual_torque(law.numbers, &fitted.mean);
                assert!(
                    (said - expected).abs() < 1e-4 * (1.0 + expected.abs()),
                    "{said} {expected}"
                );
            }
        }
    }
}
