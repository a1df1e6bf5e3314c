//! Against numbers made with Pinocchio by `tests/peers/pinocchio_reference.py`.

use std::ops::ControlFlow;

use serde::Deserialize;
use spec::{Family, Integrator, JOINTS, JobSpec, Precision, Rejection, SimulateSpec};

use crate::block::Block;
use crate::forward_dynamics::Dynamics;
use crate::lanes::{F32Array, F64Array, Kernels};
use crate::model::Model;
use crate::panda::KINEMATICS;
use crate::{
    Chirp, InstructionSet, Joints, Multisine, RigidBody, Robot, Scenario, Scenarios, Torques,
};

#[derive(Deserialize)]
struct Reference {
    panda: Vec<PandaState>,
    robots: Vec<RandomRobot>,
    trajectories: Vec<Trajectory>,
}

#[derive(Deserialize)]
struct PandaState {
    q: Joints<f64>,
    mass_matrix: Vec<f64>,
    gravity: Joints<f64>,
}

/// Parameters of one arm; `links` are mass, centre of mass (3) and inertia (6).
#[derive(Deserialize)]
struct Parameters {
    links: Joints<[f64; 10]>,
    armature: Joints<f64>,
    damping: Joints<f64>,
    gravity: f64,
}

#[derive(Deserialize)]
struct RandomRobot {
    #[serde(flatten)]
    parameters: Parameters,
    q: Joints<f64>,
    qd: Joints<f64>,
    torque: Joints<f64>,
    mass_matrix: Vec<f64>,
    bias: Joints<f64>,
    qdd: Joints<f64>,
}

#[derive(Deserialize)]
struct Trajectory {
    family: Family,
    #[serde(flatten)]
    parameters: Parameters,
    q0: Joints<f64>,
    qd0: Joints<f64>,
    coefficients: Joints<Vec<f64>>,
    q: Vec<Joints<f64>>,
}

/// Between the samples of [`Trajectory::q`].
const STRIDE: usize = 21;

fn reference() -> Reference {
    serde_json::from_str(include_str!("../tests/data/pinocchio.json")).unwrap()
}

impl Parameters {
    fn robot(&self) -> Robot {
        let body = |link: [f64; 10]| {
            let [mass, x, y, z, inertia @ ..] = link;
            RigidBody::new(mass, [x, y, z], inertia)
        };
        Robot {
            links: self.links.map(body),
            damping: self.damping,
            armature: self.armature,
            kinematics: KINEMATICS,
            friction: None,
            payload: None,
            gravity: self.gravity,
        }
    }
}

impl Trajectory {
    fn scenario(&self) -> Scenario {
        let torques = match self.family {
            Family::Chirp => Torques::Chirp(self.coefficients.each_ref().map(|c| Chirp {
                offset_nm: c[0],
                amplitude_nm: c[1],
                f1_hz: c[2],
                f2_hz: c[3],
                depth: c[4],
                phase_rad: c[5],
            })),
            Family::Multisine => {
                Torques::Multisine(self.coefficients.each_ref().map(|c| Multisine {
                    amplitude_nm: [c[0], c[1], c[2], c[3]],
                    frequency_hz: [c[4], c[5], c[6], c[7]],
                }))
            }
        };
        Scenario {
            index: 0,
            draws: 1,
            robot: self.parameters.robot(),
            family: self.family,
            frequency_hz: 0.0,
            q0: self.q0,
            qd0: self.qd0,
            torques,
        }
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

fn lower_triangle(mass_matrix: Joints<Joints<f64>>) -> Vec<f64> {
    (0..JOINTS).flat_map(|row| mass_matrix[row][..=row].to_vec()).collect()
}

#[test]
fn the_nominal_panda_has_the_mass_matrix_and_gravity_torques_of_the_reference() {
    let panda = Robot { gravity: 9.81, ..Robot::panda() };
    for state in reference().panda {
        let mass_matrix = lower_triangle(crate::mass_matrix(&panda, state.q));
        assert!(relative_error(&mass_matrix, &state.mass_matrix) < 1e-14);
        assert!(relative_error(&crate::gravity(&panda, state.q), &state.gravity) < 1e-14);
    }
}

#[test]
fn single_robots_have_the_dynamics_of_the_reference() {
    for case in reference().robots {
        let robot = case.parameters.robot();
        let mass_matrix = lower_triangle(crate::mass_matrix(&robot, case.q));
        assert!(relative_error(&mass_matrix, &case.mass_matrix) < 1e-14);
        assert!(relative_error(&crate::bias_forces(&robot, case.q, case.qd), &case.bias) < 1e-13);
        let qdd = crate::forward_dynamics(&robot, case.q, case.qd, case.torque);
        assert!(relative_error(&qdd, &case.qdd) < 1e-12);
    }
}

/// Different robots side by side, as in a simulation.
fn check_lanes<L: Kernels>(tolerance: f64) {
    for cases in reference().robots.chunks_exact(L::LANES) {
        let zero = [L::splat(0.0); JOINTS];
        let mut model = Model::<L>::splat(&Robot::panda());
        let (mut q, mut qd, mut torque, mut qdd) = (zero, zero, zero, zero);
        for (lane, case) in cases.iter().enumerate() {
            model.set_lane(lane, &case.parameters.robot());
            for joint in 0..JOINTS {
                q[joint].set_lane(lane, case.q[joint]);
                qd[joint].set_lane(lane, case.qd[joint]);
                torque[joint].set_lane(lane, case.torque[joint]);
            }
        }
        let mut dynamics = Dynamics::zero();
        L::mass_matrix_and_bias(&model, &q, &qd, &mut dynamics);
        L::accelerations(&model, &dynamics, &qd, &torque, L::splat(0.0), &mut qdd);
        for (lane, case) in cases.iter().enumerate() {
            let mass_matrix =
                lower_triangle(dynamics.mass_matrix.map(|row| row.map(|entry| entry.lane(lane))));
            assert!(relative_error(&mass_matrix, &case.mass_matrix) < tolerance);
            assert!(
                relative_error(&dynamics.bias.map(|bias| bias.lane(lane)), &case.bias) < tolerance
            );
            let error = relative_error(&qdd.map(|qdd| qdd.lane(lane)), &case.qdd);
            assert!(error < tolerance, "{error:e}");
        }
    }
}

const F64_TOLERANCE: f64 = 1e-13;
const F32_TOLERANCE: f64 = 1e-5;

#[test]
fn portable_lanes_have_the_dynamics_of_the_reference() {
    check_lanes::<F64Array<4>>(F64_TOLERANCE);
    check_lanes::<F32Array<8>>(F32_TOLERANCE);
}

#[cfg(target_arch = "x86_64")]
#[test]
fn avx2_lanes_have_the_dynamics_of_the_reference() {
    if InstructionSet::available().len() >= 2 {
        check_lanes::<crate::lanes::F64x4>(F64_TOLERANCE);
        check_lanes::<crate::lanes::F32x8>(F32_TOLERANCE);
    }
}

#[cfg(target_arch = "x86_64")]
#[test]
fn avx512_lanes_have_the_dynamics_of_the_reference() {
    if InstructionSet::available().len() >= 3 {
        check_lanes::<crate::lanes::F64x8>(F64_TOLERANCE);
        check_lanes::<crate::lanes::F32x16>(F32_TOLERANCE);
    }
}

/// Largest distance from the reference over all trajectories, rad.
fn trajectory_error(
    instructions: InstructionSet,
    precision: Precision,
    integrator: Integrator,
) -> f64 {
    let text = br#"{"kind": "simulate", "trajectories": 1, "excitation": {"multisine": {"frequency_hz": {"fixed": 0.1}}}}"#;
    let JobSpec::Simulate(spec) = spec::parse(text).unwrap() else { panic!("not a simulation") };
    let rejection = Rejection { position_margin_rad: None, ..Rejection::default() };
    let spec = SimulateSpec { precision, integrator, rejection, ..spec };

    let trajectories = reference().trajectories;
    let mut scenarios: Vec<_> = trajectories.iter().map(Trajectory::scenario).collect();
    let row_len = spec.samples as usize * JOINTS;
    let (mut u, mut q) = (vec![0.0; 4 * row_len], vec![0.0; 4 * row_len]);
    let mut block = Block {
        source: &Scenarios::new(&spec),
        scenarios: &mut scenarios,
        u: &mut u,
        q: &mut q,
        qd: None,
        end_effector: None,
        finished: &|_| ControlFlow::Continue(()),
    };
    instructions.simulate(precision, &mut block).unwrap();

    let mut worst: f64 = 0.0;
    for (trajectory, q) in trajectories.iter().zip(q.chunks_exact(row_len)) {
        for (expected, sample) in trajectory.q.iter().zip(q.chunks_exact(JOINTS).step_by(STRIDE)) {
            for (expected, &value) in expected.iter().zip(sample) {
                worst = worst.max((f64::from(value) - expected).abs());
            }
        }
    }
    worst
}

#[test]
fn whole_trajectories_follow_the_reference_on_every_instruction_set() {
    let fine = Integrator::Extrapolated { order: 4, substeps: 4 };
    for instructions in InstructionSet::available() {
        // Stored positions are f32 and reach 4 rad: 2.4e-7 is half their last place.
        let error = trajectory_error(instructions, Precision::F64, fine);
        assert!(error < 4e-7, "{instructions}, f64: {error:e} rad");
        let error = trajectory_error(instructions, Precision::F32, fine);
        assert!(error < 1e-5, "{instructions}, f32: {error:e} rad");
    }
}

#[test]
fn the_default_integrator_stays_within_a_ten_thousandth_of_a_radian() {
    for precision in [Precision::F32, Precision::F64] {
        let error = trajectory_error(InstructionSet::best(), precision, Integrator::default());
        assert!(error < 1e-4, "{precision:?}: {error:e} rad");
    }
}
