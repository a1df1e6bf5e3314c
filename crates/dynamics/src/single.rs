//! The dynamics of one robot, for baselines, figures and tests.
//!
//! It is the same code as on vectors, with one lane.

use simd::{F32Array, F64Array, Lanes};
use spec::Precision;

use crate::forward_dynamics::Dynamics;
use crate::kernels::{Accelerations, MassMatrixAndBias};
use crate::model::Model;
use crate::spatial::Turn;
use crate::structure::{Kind, Structure, with_structure};
use crate::{ArmState, Joints, Robot};

type Lane = F64Array<1>;

/// M(q) + A, symmetric positive definite, kg·m²; `q` in rad.
pub fn mass_matrix(robot: &Robot, q: impl Into<Joints<f64>>) -> Joints<Joints<f64>> {
    let q = q.into();
    let at_rest = Joints::splat(q.len(), 0.0);
    with_structure!(Kind::of([robot]), |structure| {
        full(&dynamics::<Lane, _, _>(structure, robot, &q, &at_rest), q.len())
    })
}

/// C(q, q̇) q̇ + g(q), N·m, with `q` in rad and `qd` in rad/s. It excludes damping and friction.
pub fn bias_forces(
    robot: &Robot,
    q: impl Into<Joints<f64>>,
    qd: impl Into<Joints<f64>>,
) -> Joints<f64> {
    let (q, qd) = (q.into(), qd.into());
    with_structure!(Kind::of([robot]), |structure| {
        numbers(&dynamics::<Lane, _, _>(structure, robot, &q, &qd).bias, q.len())
    })
}

/// g(q), N·m: the torques that hold the arm still at `q` (rad).
pub fn gravity(robot: &Robot, q: impl Into<Joints<f64>>) -> Joints<f64> {
    bias_forces(robot, q, Joints::splat(robot.joints(), 0.0))
}

/// q̈ in rad/s² under `torque` (N·m), with damping and friction.
pub fn forward_dynamics(
    robot: &Robot,
    q: impl Into<Joints<f64>>,
    qd: impl Into<Joints<f64>>,
    torque: impl Into<Joints<f64>>,
) -> Joints<f64> {
    let (q, qd, torque) = (q.into(), qd.into(), torque.into());
    with_structure!(Kind::of([robot]), |structure| {
        accelerations::<Lane, _, _>(structure, robot, &q, &qd, &torque).1
    })
}

/// The torque for the accelerations `qdd` (rad/s²), with damping and friction, N·m: the inverse of
/// [`forward_dynamics`].
pub fn inverse_dynamics(
    robot: &Robot,
    q: impl Into<Joints<f64>>,
    qd: impl Into<Joints<f64>>,
    qdd: impl Into<Joints<f64>>,
) -> Joints<f64> {
    let (q, qd, qdd) = (q.into(), qd.into(), qdd.into());
    let joints = q.len();
    let no_torque = Joints::splat(joints, 0.0);
    let (mass_matrix, free) = with_structure!(Kind::of([robot]), |structure| {
        let (dynamics, free) = accelerations::<Lane, _, _>(structure, robot, &q, &qd, &no_torque);
        (full(&dynamics, joints), free)
    });
    let torque = |row: usize| {
        (0..joints).map(|column| mass_matrix[row][column] * (qdd[column] - free[column])).sum()
    };
    Joints::from_fn(joints, torque)
}

/// The equation of motion of one robot at one state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluation {
    /// q̈ under the torques, with damping and friction, rad/s².
    pub qdd: Joints<f64>,
    /// g(q), N·m.
    pub gravity: Joints<f64>,
    /// C(q, q̇) q̇ + g(q), N·m.
    pub bias: Joints<f64>,
    /// M(q) + A, kg·m².
    pub mass_matrix: Joints<Joints<f64>>,
}

impl Evaluation {
    /// The equation at `state` under `torque` (N·m), computed in `precision` by the arithmetic of simulations.
    pub fn new(
        robot: &Robot,
        precision: Precision,
        state: &ArmState,
        torque: impl Into<Joints<f64>>,
    ) -> Self {
        let torque = torque.into();
        with_structure!(Kind::of([robot]), |structure| match precision {
            Precision::F32 => evaluation::<F32Array<1>, _, _>(structure, robot, state, &torque),
            Precision::F64 => evaluation::<F64Array<1>, _, _>(structure, robot, state, &torque),
        })
    }
}

fn evaluation<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    robot: &Robot,
    ArmState { q, qd }: &ArmState,
    torque: &Joints<f64>,
) -> Evaluation {
    let at_rest = Joints::splat(q.len(), 0.0);
    let gravity = dynamics::<L, S, N>(structure, robot, q, &at_rest).bias;
    let (dynamics, qdd) = accelerations::<L, S, N>(structure, robot, q, qd, torque);
    Evaluation {
        qdd,
        gravity: numbers(&gravity, q.len()),
        bias: numbers(&dynamics.bias, q.len()),
        mass_matrix: full(&dynamics, q.len()),
    }
}

/// The dynamics at a state, and q̈ under `torque`.
fn accelerations<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    robot: &Robot,
    q: &Joints<f64>,
    qd: &Joints<f64>,
    torque: &Joints<f64>,
) -> (Dynamics<L, N>, Joints<f64>) {
    let dynamics = dynamics::<L, S, N>(structure, robot, q, qd);
    let qd = lanes(qd);
    let mut qdd = qd;
    L::run(Accelerations {
        structure,
        model: &Model::splat(structure, robot),
        dynamics: &dynamics,
        qd: &qd,
        torque: &lanes(torque),
        step: L::splat(0.0),
        qdd: &mut qdd,
    });
    (dynamics, numbers(&qdd, q.len()))
}

fn dynamics<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    robot: &Robot,
    q: &Joints<f64>,
    qd: &Joints<f64>,
) -> Dynamics<L, N> {
    let mut dynamics = Dynamics::zero();
    let mut at_q = [Turn::none(); N];
    let model = &Model::splat(structure, robot);
    structure.turns(model, &lanes(q), &mut at_q);
    let (turns, qd) = (&at_q, &lanes(qd));
    L::run(MassMatrixAndBias { structure, model, turns, qd, dynamics: &mut dynamics });
    dynamics
}

/// The whole symmetric matrix of `count` joints.
fn full<L: Lanes, const N: usize>(dynamics: &Dynamics<L, N>, count: usize) -> Joints<Joints<f64>> {
    let entry =
        |row: usize, column: usize| dynamics.mass_matrix[row.max(column)][row.min(column)].lane(0);
    Joints::from_fn(count, |row| Joints::from_fn(count, |column| entry(row, column)))
}

fn numbers<L: Lanes, const N: usize>(lanes: &[L; N], count: usize) -> Joints<f64> {
    lanes.iter().take(count).map(|lanes| lanes.lane(0)).collect()
}

fn lanes<L: Lanes, const N: usize>(values: &Joints<f64>) -> [L; N] {
    let mut lanes = [L::splat(0.0); N];
    for (lane, &value) in lanes.iter_mut().zip(values) {
        *lane = L::splat(value);
    }
    lanes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_evaluation_in_f64_has_the_bits_of_the_separate_functions_and_one_in_f32_is_near() {
        let robot = Robot { gravity: 9.81, ..Robot::panda() };
        let q = Joints::from([0.1, -0.3, 0.2, -1.5, 0.4, 1.9, 0.8]);
        let qd = Joints::from_fn(7, |joint| 0.5 - 0.2 * joint as f64);
        let torque = Joints::from_fn(7, |joint| 3.0 - joint as f64);
        let state = ArmState { q, qd };
        let evaluation = Evaluation::new(&robot, Precision::F64, &state, torque);
        assert_eq!(evaluation.qdd, forward_dynamics(&robot, q, qd, torque));
        assert_eq!(evaluation.gravity, gravity(&robot, q));
        assert_eq!(evaluation.bias, bias_forces(&robot, q, qd));
        assert_eq!(evaluation.mass_matrix, mass_matrix(&robot, q));

        let again = inverse_dynamics(&robot, q, qd, evaluation.qdd);
        for (again, torque) in again.iter().zip(&torque) {
            assert!((again - torque).abs() < 1e-11, "{again} {torque}");
        }

        let single = Evaluation::new(&robot, Precision::F32, &state, torque);
        assert_ne!(single.qdd, evaluation.qdd);
        let largest = evaluation.qdd.iter().fold(0.0, |most: f64, qdd| most.max(qdd.abs()));
        for (single, double) in single.qdd.iter().zip(&evaluation.qdd) {
            assert!((single - double).abs() < 5e-5 * largest, "{single} {double}");
        }
    }
}
