//! A law that is told the arm.

use std::f64::consts::FRAC_PI_2;

use serde_json::json;
use simd::InstructionSet;
use spec::LagrangianSpec;

use super::{CONTEXT, EXACT, JOINT, Motions, RATE_HZ, SAMPLES, predict, separate, spec};
use crate::architecture::{Architecture, Extents};
use crate::initialization::InitialWeights;
use crate::lagrangian::Lagrangian;
use crate::lagrangian::batch::Points;
use crate::lagrangian::recorded::Recorded;
use crate::lagrangian::regression::{Bounds, Numbers};
use burn::tensor::Device;

fn told(robot: serde_json::Value, joints: usize) -> Lagrangian {
    let robot = Some(serde_json::from_value(robot).unwrap());
    let spec = LagrangianSpec { robot, rotor_inertia: true, torque_offset: true, ..spec() };
    let device = Device::flex();
    let mut weights = InitialWeights::new(3, &device);
    let extents = Extents::new(CONTEXT as u32, SAMPLES as u32, joints).unwrap();
    spec.init(extents, &mut weights).unwrap()
}

/// Two links that swing in a vertical plane: lengths and centres along x, masses, inertias about z.
const LENGTH: f64 = 0.6;
const CENTERS: [f64; 2] = [0.25, 0.2];
const MASSES: [f64; 2] = [3.0, 2.0];
const INERTIAS: [f64; 2] = [0.12, 0.05];

fn pendulum() -> serde_json::Value {
    let joint = |index: usize, a_m: f64| {
        let inertia = INERTIAS[index];
        json!({
            "name": format!("joint {index}"), "a_m": a_m, "alpha_deg": 0, "d_m": 0,
            "position_rad": [-6.0, 6.0], "velocity_rad_s": 3, "torque_nm": 50, "damping_nm_s_rad": 1,
            "link": {
                "mass_kg": MASSES[index], "center_m": [CENTERS[index], 0, 0],
                "inertia_kg_m2": [0.6 * inertia, 0, 0, 0.7 * inertia, 0, inertia],
            },
        })
    };
    json!({"model": {
        "name": "pendulum", "base": {"rpy_deg": [90, 0, 0]}, "joints": [joint(0, 0.0), joint(1, LENGTH)],
        "initial_state": {"center_rad": [0, 0]},
    }})
}

/// The torques of the pendulum, from its textbook equations.
fn expected(q: [f64; 2], v: [f64; 2], a: [f64; 2]) -> [f64; 2] {
    let ([m1, m2], [c1, c2], [i1, i2]) = (MASSES, CENTERS, INERTIAS);
    let (coupling, gravity) = (m2 * LENGTH * c2, 9.81);
    let second = i2 + m2 * c2 * c2;
    let mixed = second + coupling * q[1].cos();
    let first = i1 + m1 * c1 * c1 + m2 * LENGTH * LENGTH + second + 2.0 * coupling * q[1].cos();
    let swing = coupling * q[1].sin();
    let weight = m2 * gravity * c2 * (q[0] + q[1]).cos();
    [
        first * a[0] + mixed * a[1] - swing * (2.0 * v[0] * v[1] + v[1] * v[1])
            + gravity * (m1 * c1 + m2 * LENGTH) * q[0].cos()
            + weight,
        mixed * a[0] + second * a[1] + swing * v[0] * v[0] + weight,
    ]
}

#[test]
fn the_described_moments_have_the_torques_of_the_arm() {
    let model = told(pendulum(), 2);
    let kinematics = model.kinematics().unwrap();
    let y: Vec<f32> = [[0.1, -0.9], [0.13, -0.86], [0.17, -0.84], [0.2, -0.8]].concat();
    let robot = Recorded { u: &[0.0; 8], y: &y, joints: 2, rate_hz: RATE_HZ };
    let mut points = Points::new([1, 2, 2], 0);
    (1..3).for_each(|sample| points.push(&robot, sample));
    let [q, v, a] = points.states().map(<[f32]>::to_vec);
    for instructions in InstructionSet::available() {
        let torques = kinematics.torques_of_moments(instructions, points.states());
        for (point, of_joints) in torques.chunks_exact(2 * kinematics.particles()).enumerate() {
            let state = |values: &[f32]| [0, 1].map(|joint| f64::from(values[2 * point + joint]));
            let expected = expected(state(&q), state(&v), state(&a));
            for (of_particles, expected) in
                of_joints.chunks_exact(kinematics.particles()).zip(expected)
            {
                let described = kinematics.described();
                let found: f32 = of_particles.iter().zip(described).map(|(a, b)| a * b).sum();
                assert!((f64::from(found) - expected).abs() < 1e-4, "{found} {expected}");
            }
        }
    }
}

#[test]
fn predictions_of_a_told_arm_have_the_same_bits_on_every_processor() {
    for (robot, joints) in [("ur10e", 6), ("panda", 7)] {
        let law = told(json!({"model": robot}), joints).law();
        let motions = Motions::new(21, joints);
        let robots = motions.robots();
        let together = predict(&law, &robots, EXACT);
        assert!(together.iter().all(|position| position.is_finite()));
        for instructions in InstructionSet::available() {
            assert_eq!(
                law.predict(instructions, &robots, EXACT, &[], 0),
                together,
                "{instructions}"
            );
        }
    }
}

#[test]
fn a_prediction_stays_within_the_limits_of_the_arm_unless_it_begins_beyond_them() {
    let law = told(pendulum(), 2).law();
    // Torques that no joint withstands, up and then down. The second arm begins beyond a limit.
    let u: Vec<f32> = (0..4 * SAMPLES).map(|k| if k < 3 * SAMPLES { 4e3 } else { -4e3 }).collect();
    for (first, limits) in [(0.5, [-6.0, 6.0]), (6.4, [-6.0, 6.4])] {
        let y = [first, 0.3].repeat(CONTEXT);
        let robot = Recorded { u: &u, y: &y, joints: 2, rate_hz: RATE_HZ };
        let path = predict(&law, &[robot], EXACT);
        let mut last = [first, 0.3];
        for position in path.chunks_exact(2) {
            let within = |joint: usize, [low, high]: [f32; 2]| {
                let speed = (position[joint] - last[joint]).abs() * RATE_HZ;
                (low - 1e-4..=high + 1e-4).contains(&position[joint]) && speed < 1.25 * 3.0 + 1e-3
            };
            assert!(within(0, limits) && within(1, [-6.0, 6.0]), "{position:?} after {last:?}");
            last.copy_from_slice(position);
        }
    }
}

#[test]
fn an_arm_of_other_joints_is_refused() {
    let robot = Some(serde_json::from_value(json!({"model": "ur10e"})).unwrap());
    let spec = LagrangianSpec { robot, ..spec() };
    let device = Device::flex();
    let mut weights = InitialWeights::new(3, &device);
    let extents = Extents::new(CONTEXT as u32, SAMPLES as u32, 7).unwrap();
    let refused = spec.init(extents, &mut weights).unwrap_err().to_string();
    assert!(refused.contains("joints is 7, allowed: 6"), "{refused}");
}

/// Joints of a known mass under waves of torques, with rotors and offsets that the law has to find.
#[test]
fn rotors_and_offsets_are_found_and_the_horizon_follows() {
    let masses = [0.5, 0.02];
    let (rotors, offsets): ([f64; 2], [f64; 2]) = ([0.3, 0.08], [0.4, -0.2]);
    let mut law = separate(&masses, JOINT, [10.0, 1.0]);
    law.numbers = Numbers { rotors: true, offsets: true, ..law.numbers };
    law.prior.mean.extend([0.1, 0.1, 0.0, 0.0]);
    law.prior.spread.extend([0.2, 0.2, 0.5, 0.5]);
    let wave = |index: usize| 4.0 * (0.11 * index as f64 + FRAC_PI_2 * (index % 2) as f64).sin();
    let u: Vec<f32> = (0..SAMPLES * 2).map(|index| wave(index) as f32).collect();
    let mut y = vec![0.0_f32; SAMPLES * 2];
    let mut velocity = [0.0_f64; 2];
    for sample in 1..SAMPLES {
        for joint in 0..2 {
            let inertia = (f64::from(masses[joint]) + rotors[joint]) * f64::from(RATE_HZ);
            let torque = f64::from(u[(sample - 1) * 2 + joint]) - offsets[joint];
            velocity[joint] = (torque + inertia * velocity[joint]) / (inertia + 9.0);
            y[sample * 2 + joint] =
                y[(sample - 1) * 2 + joint] + (velocity[joint] / f64::from(RATE_HZ)) as f32;
        }
    }
    let robot = Recorded { u: &u, y: &y[..CONTEXT * 2], joints: 2, rate_hz: RATE_HZ };
    let found = law.fit(InstructionSet::best(), &robot, Bounds::Dissipation).mean;
    for joint in 0..2 {
        let rotor = found[law.numbers.rotors()][joint];
        let offset = found[law.numbers.offsets()][joint];
        assert!((rotor - rotors[joint]).abs() < 5e-3, "{found:?}");
        assert!((offset - offsets[joint]).abs() < 5e-3, "{found:?}");
    }
    for (predicted, expected) in predict(&law, &[robot], EXACT).iter().zip(&y[CONTEXT * 2..]) {
        assert!((predicted - expected).abs() < 2e-4, "{predicted} {expected}");
    }
}
