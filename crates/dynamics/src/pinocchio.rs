//! Compares the dynamics with numbers that `tests/peers/pinocchio_reference.py` made with
//! Pinocchio.

use std::ops::ControlFlow;

use serde::Deserialize;
use simd::{F32Array, F64Array, InstructionSet, Lanes};
use spec::{
    Family, Gravity, Integrator, JobSpec, MAX_JOINTS, Precision, Rejection, RobotSpec, SimulateSpec,
};

use crate::block::Block;
use crate::compiled::{Compiled, JOINTS};
use crate::forward_dynamics::Dynamics;
use crate::general::General;
use crate::kernels::{Accelerations, AccelerationsAt, MassMatrixAndBias};
use crate::model::Model;
use crate::robot::{Hand, Nominal, Parts};
use crate::spatial::Turn;
use crate::structure::Structure;
use crate::{
    Chirp, Excitation, Friction, Joints, Kinematics, Multisine, Payload, RigidBody, Robot,
    Scenario, Scenarios, Torques, dispatch,
};

#[derive(Deserialize)]
struct Reference {
    panda: Vec<PandaState>,
    trajectories: Vec<Trajectory>,
}

type Seven<T> = [T; JOINTS];

#[derive(Deserialize)]
struct PandaState {
    lengths: [f64; 7],
    /// Mass, centre (3), radius.
    payload: Option<[f64; 5]>,
    q: Seven<f64>,
    mass_matrix: Vec<f64>,
    gravity: Seven<f64>,
    /// Position, then quaternion x, y, z, w.
    pose: [f64; 7],
}

/// One arm in one state, with Pinocchio's results.
struct RandomRobot {
    robot: Robot,
    q: Joints<f64>,
    qd: Joints<f64>,
    torque: Joints<f64>,
    mass_matrix: Vec<f64>,
    bias: Vec<f64>,
    qdd: Vec<f64>,
}

/// `links` has mass, centre of mass (3) and inertia (6) of each link.
#[derive(Deserialize)]
struct Trajectory {
    family: Family,
    gravity: Gravity,
    links: Seven<[f64; 10]>,
    lengths: [f64; 7],
    armature: Seven<f64>,
    damping: Seven<f64>,
    /// φ1, φ2, φ3.
    friction: Option<[Seven<f64>; 3]>,
    q0: Seven<f64>,
    qd0: Seven<f64>,
    coefficients: Seven<Vec<f64>>,
    q: Vec<Seven<f64>>,
}

/// Samples between two rows of [`Trajectory::q`].
const STRIDE: usize = 21;

fn reference() -> Reference {
    serde_json::from_str(include_str!("../tests/data/pinocchio.json")).unwrap()
}

fn kinematics([a4, a5, a7, d1, d3, d5, flange_m]: [f64; 7]) -> Kinematics {
    let mut kinematics = Robot::panda().kinematics;
    for (row, a_m) in kinematics.joints.iter_mut().zip([0.0, 0.0, 0.0, a4, a5, 0.0, a7]) {
        row.a_m = a_m;
    }
    for (row, d_m) in kinematics.joints.iter_mut().zip([d1, 0.0, d3, 0.0, d5, 0.0, 0.0]) {
        row.d_m = d_m;
    }
    kinematics.hand.d_m = flange_m;
    kinematics
}

fn body([mass, x, y, z, inertia @ ..]: [f64; 10]) -> RigidBody {
    RigidBody::new(mass, [x, y, z], inertia)
}

fn friction([phi1_nm, phi2_s_rad, phi3_rad_s]: [Seven<f64>; 3]) -> Friction {
    Friction {
        phi1_nm: phi1_nm.into(),
        phi2_s_rad: phi2_s_rad.into(),
        phi3_rad_s: phi3_rad_s.into(),
    }
}

fn random_robots() -> Vec<RandomRobot> {
    const INPUTS: usize = 134;
    const RESULTS: usize = 42;

    let bytes = include_bytes!("../tests/data/pinocchio_robots.bin");
    let records = bytes.chunks_exact(INPUTS * 4 + RESULTS * 8);
    assert!(records.remainder().is_empty());
    let robot = |record: &[u8]| {
        let (inputs, results) = record.split_at(INPUTS * 4);
        let mut inputs =
            inputs.as_chunks().0.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes)));
        let mut results = results.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes));
        let mut joints = || -> Seven<f64> { std::array::from_fn(|_| inputs.next().unwrap()) };

        let links: Vec<f64> = (0..10).flat_map(|_| joints()).collect();
        let links = Joints::from_fn(JOINTS, |link| body(links.as_chunks().0[link]));
        let kinematics = kinematics(joints());
        let (armature, damping) = (joints(), joints());
        let mut rest: Vec<f64> = (0..6).flat_map(|_| joints()).collect();
        let gravity = rest.remove(0);
        rest.push(inputs.next().unwrap());
        let part = |at: usize| -> Seven<f64> { rest.as_chunks().0[at] };
        let phi = [part(0), part(1), part(2)];
        let has_friction = phi[0] != [0.0; JOINTS];
        RandomRobot {
            robot: Robot {
                links,
                damping: damping.into(),
                armature: armature.into(),
                kinematics,
                friction: has_friction.then(|| friction(phi)),
                payload: None,
                gravity,
            },
            q: part(3).into(),
            qd: part(4).into(),
            torque: part(5).into(),
            mass_matrix: results.by_ref().take(28).collect(),
            bias: results.by_ref().take(JOINTS).collect(),
            qdd: results.collect(),
        }
    };
    records.map(robot).collect()
}

impl Trajectory {
    fn scenario(&self) -> Scenario {
        let torques = match self.family {
            Family::Chirp => Torques::Chirp(
                self.coefficients
                    .iter()
                    .map(|c| Chirp {
                        offset_nm: c[0],
                        amplitude_nm: c[1],
                        f1_hz: c[2],
                        f2_hz: c[3],
                        depth: c[4],
                        phase_rad: c[5],
                    })
                    .collect(),
            ),
            Family::Multisine => Torques::Multisine(
                self.coefficients
                    .iter()
                    .map(|c| Multisine {
                        amplitude_nm: [c[0], c[1], c[2], c[3]],
                        frequency_hz: [c[4], c[5], c[6], c[7]],
                    })
                    .collect(),
            ),
            family => unreachable!("the peer has no {family}"),
        };
        let robot = Robot {
            links: self.links.map(body).into(),
            damping: self.damping.into(),
            armature: self.armature.into(),
            kinematics: kinematics(self.lengths),
            friction: self.friction.map(friction),
            payload: None,
            gravity: if self.gravity == Gravity::Off { 0.0 } else { 9.81 },
        };
        Scenario {
            index: 0,
            draws: 1,
            robot,
            family: self.family,
            frequency_hz: 0.0,
            q0: self.q0.into(),
            qd0: self.qd0.into(),
            excitation: Excitation::OpenLoop(torques),
        }
    }

    /// Largest distance from the reference, rad.
    fn error(
        &self,
        instructions: InstructionSet,
        precision: Precision,
        integrator: Integrator,
    ) -> f64 {
        let text = br#"{"kind": "simulate", "trajectories": 1, "excitation": {"multisine": {"frequency_hz": {"fixed": 0.1}}}}"#;
        let JobSpec::Simulate(mut spec) = spec::parse(text).unwrap() else {
            panic!("not a simulation")
        };
        spec.rejection = Rejection { position_margin_rad: None, ..Rejection::default() };
        spec.robot.gravity = self.gravity;
        let spec = SimulateSpec { precision, integrator, ..spec };

        let row_len = spec.samples as usize * JOINTS;
        let (mut u, mut q) = (vec![0.0; row_len], vec![0.0; row_len]);
        let source = Scenarios::new(&spec);
        let mut block = Block {
            source: &source,
            scenarios: &mut [self.scenario()],
            u: &mut u,
            q: &mut q,
            qd: None,
            reference: None,
            measured: None,
            end_effector: None,
            finished: &|_| ControlFlow::Continue(()),
        };
        dispatch::simulate(instructions, precision, source.kind(), &mut block).unwrap();

        let mut worst: f64 = 0.0;
        for (expected, sample) in self.q.iter().zip(q.chunks_exact(JOINTS).step_by(STRIDE)) {
            for (expected, &value) in expected.iter().zip(sample) {
                worst = worst.max((f64::from(value) - expected).abs());
            }
        }
        worst
    }
}

/// Largest difference between two sets of numbers, relative to the largest of the second.
fn relative_error(values: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(values.len(), expected.len());
    let largest = |numbers: &mut dyn Iterator<Item = f64>| numbers.fold(0.0, f64::max);
    let error =
        largest(&mut values.iter().zip(expected).map(|(value, expected)| (value - expected).abs()));
    error / largest(&mut expected.iter().map(|expected| expected.abs()))
}

fn lower_triangle(mass_matrix: &[impl std::ops::Deref<Target = [f64]>]) -> Vec<f64> {
    (0..JOINTS).flat_map(|row| mass_matrix[row][..=row].to_vec()).collect()
}

#[test]
fn the_panda_has_the_mass_matrix_gravity_torques_and_hand_of_the_reference_bare_and_loaded() {
    for state in reference().panda {
        let payload = state.payload.map(|[mass_kg, x, y, z, radius_m]| Payload {
            mass_kg,
            center_m: [x, y, z],
            radius_m,
        });
        let spec = RobotSpec::default();
        let nominal = Nominal::of(spec.description());
        let hand = nominal.attached.iter();
        let parts = Parts {
            links: nominal.links,
            hand: hand.fold(Hand::default(), |hand, (body, at)| hand.with(body, *at)),
            damping: Joints::splat(JOINTS, 10.0),
            armature: Joints::splat(JOINTS, 0.01),
            kinematics: kinematics(state.lengths),
            friction: None,
            payload,
        };
        if payload.is_none() {
            assert_eq!(parts.kinematics, nominal.kinematics);
        }
        let panda = parts.assembled(Gravity::On);
        let mass_matrix = lower_triangle(&crate::mass_matrix(&panda, state.q));
        assert!(relative_error(&mass_matrix, &state.mass_matrix) < 1e-14);
        assert!(relative_error(&crate::gravity(&panda, state.q), &state.gravity) < 1e-14);

        let pose = panda.kinematics.end_effector_pose(state.q);
        let (position, quaternion) = state.pose.split_at(3);
        assert!(relative_error(&pose.position_m, position) < 1e-14);
        // Either of the two quaternions of an orientation.
        let dot: f64 = pose.quaternion_xyzw.iter().zip(quaternion).map(|(a, b)| a * b).sum();
        assert!((dot.abs() - 1.0).abs() < 1e-14);
    }
}

#[test]
fn single_robots_have_the_dynamics_of_the_reference() {
    for case in random_robots() {
        let robot = case.robot;
        let mass_matrix = lower_triangle(&crate::mass_matrix(&robot, case.q));
        assert!(relative_error(&mass_matrix, &case.mass_matrix) < 1e-13);
        assert!(relative_error(&crate::bias_forces(&robot, case.q, case.qd), &case.bias) < 1e-12);
        let qdd = crate::forward_dynamics(&robot, case.q, case.qd, case.torque);
        assert!(relative_error(&qdd, &case.qdd) < 1e-12);
    }
}

/// Tests different robots side by side, as in a simulation.
fn check_lanes<L: Lanes>(tolerance: f64) {
    check_structure::<L, Compiled, JOINTS>(Compiled, tolerance);
    check_structure::<L, General<JOINTS>, JOINTS>(General::new(JOINTS), tolerance);
    check_structure::<L, General<MAX_JOINTS>, MAX_JOINTS>(General::new(JOINTS), tolerance);
}

fn check_structure<L: Lanes, S: Structure<N>, const N: usize>(structure: S, tolerance: f64) {
    for cases in random_robots().chunks_exact(L::LANES) {
        let zero = [L::splat(0.0); N];
        let mut model = Model::<L, N>::splat(structure, &Robot::panda());
        let (mut q, mut qd, mut torque, mut qdd) = (zero, zero, zero, zero);
        for (lane, case) in cases.iter().enumerate() {
            model.set_lane(structure, lane, &case.robot);
            for joint in 0..JOINTS {
                q[joint].set_lane(lane, case.q[joint]);
                qd[joint].set_lane(lane, case.qd[joint]);
                torque[joint].set_lane(lane, case.torque[joint]);
            }
        }
        let mut dynamics = Dynamics::zero();
        let mut at_q = [Turn::none(); N];
        structure.turns(&model, &q, &mut at_q);
        let (model, turns, qd, torque) = (&model, &at_q, &qd, &torque);
        L::run(MassMatrixAndBias { structure, model, turns, qd, dynamics: &mut dynamics });
        for step in [1.0 / 60.0, 0.0].map(L::splat) {
            let mut at_once = zero;
            let (dynamics, together) = (&dynamics, &mut at_once);
            L::run(Accelerations { structure, model, dynamics, qd, torque, step, qdd: &mut qdd });
            L::run(AccelerationsAt { structure, model, turns, qd, torque, step, qdd: together });
            let bits = |qdd: &[L; N]| -> Vec<u64> {
                let lanes = (0..L::LANES)
                    .flat_map(|lane| qdd.iter().map(move |acceleration| acceleration.lane(lane)));
                lanes.map(f64::to_bits).collect()
            };
            assert_eq!(bits(&at_once), bits(&qdd));
        }
        for (lane, case) in cases.iter().enumerate() {
            let lane_of = |values: &[L; N]| -> Joints<f64> {
                values[..JOINTS].iter().map(|value| value.lane(lane)).collect()
            };
            let mass_matrix = dynamics.mass_matrix.each_ref().map(lane_of);
            let error = relative_error(&lower_triangle(&mass_matrix), &case.mass_matrix);
            assert!(error < tolerance, "{error:e}");
            assert!(relative_error(&lane_of(&dynamics.bias), &case.bias) < tolerance);
            let error = relative_error(&lane_of(&qdd), &case.qdd);
            assert!(error < tolerance, "{error:e}");
        }
    }
}

const F64_TOLERANCE: f64 = 1e-12;
const F32_TOLERANCE: f64 = 5e-5;

#[test]
fn portable_lanes_have_the_dynamics_of_the_reference() {
    check_lanes::<F64Array<4>>(F64_TOLERANCE);
    check_lanes::<F32Array<8>>(F32_TOLERANCE);
}

#[cfg(target_arch = "x86_64")]
#[test]
fn avx2_lanes_have_the_dynamics_of_the_reference() {
    if InstructionSet::available().len() >= 2 {
        check_lanes::<simd::F64x4>(F64_TOLERANCE);
        check_lanes::<simd::F32x8>(F32_TOLERANCE);
    }
}

#[cfg(target_arch = "x86_64")]
#[test]
fn avx512_lanes_have_the_dynamics_of_the_reference() {
    if InstructionSet::available().len() >= 3 {
        check_lanes::<simd::F64x8>(F64_TOLERANCE);
        check_lanes::<simd::F32x16>(F32_TOLERANCE);
    }
}

#[test]
fn whole_trajectories_follow_the_reference_on_every_instruction_set() {
    for (case, trajectory) in reference().trajectories.iter().enumerate() {
        let fine = match trajectory.friction {
            None => Integrator::Extrapolated { order: 4, substeps: 4 },
            // Extrapolation needs a smooth solution. The friction law has a bend.
            Some(_) => Integrator::Rk4 { substeps: 24 },
        };
        for instructions in InstructionSet::available() {
            // Stored positions are f32 and reach 4 rad: 2.4e-7 is half their last place.
            let error = trajectory.error(instructions, Precision::F64, fine);
            assert!(error < 4e-7, "{case}, {instructions}, f64: {error:e} rad");
            let error = trajectory.error(instructions, Precision::F32, fine);
            assert!(error < 1e-5, "{case}, {instructions}, f32: {error:e} rad");
        }
    }
}

#[test]
fn the_default_integrator_is_accurate_without_friction_and_runge_kutta_also_with() {
    for (case, trajectory) in reference().trajectories.iter().enumerate() {
        // With friction, this torque of a dozen N·m at 1 Hz exceeds the resolution of the default
        // scheme.
        let limit_rad = if trajectory.friction.is_none() { 1e-5 } else { 3e-4 };
        for precision in [Precision::F32, Precision::F64] {
            let error = trajectory.error(InstructionSet::best(), precision, Integrator::default());
            println!("{case}, {precision:?}: {error:.1e} rad");
            assert!(error < limit_rad, "{case}, {precision:?}: {error:e} rad");
            let error = trajectory.error(
                InstructionSet::best(),
                precision,
                Integrator::Rk4 { substeps: 6 },
            );
            println!("{case}, {precision:?}, RK4: {error:.1e} rad");
            assert!(error < 1e-4, "{case}, {precision:?}, RK4: {error:e} rad");
        }
    }
}
