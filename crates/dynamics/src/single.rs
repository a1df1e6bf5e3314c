//! The dynamics of one robot in f64, for baselines, figures and tests.
//!
//! It is the same code as on vectors, with one lane.

use simd::{F64Array, Lanes};

use crate::forward_dynamics::Dynamics;
use crate::kernels::{Accelerations, MassMatrixAndBias};
use crate::model::Model;
use crate::spatial::Turn;
use crate::structure::{Kind, Structure, with_structure};
use crate::{Joints, Robot};

type Lane = F64Array<1>;

/// M(q) + A, symmetric positive definite, kg·m²; `q` in rad.
pub fn mass_matrix(robot: &Robot, q: impl Into<Joints<f64>>) -> Joints<Joints<f64>> {
    let q = q.into();
    let at_rest = Joints::splat(q.len(), 0.0);
    with_structure!(Kind::of([robot]), |structure| {
        let Dynamics { mass_matrix, .. } = dynamics(structure, robot, &q, &at_rest);
        let entry =
            |row: usize, column: usize| mass_matrix[row.max(column)][row.min(column)].lane(0);
        Joints::from_fn(q.len(), |row| Joints::from_fn(q.len(), |column| entry(row, column)))
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
        let dynamics = dynamics(structure, robot, &q, &qd);
        Joints::from_fn(q.len(), |joint| dynamics.bias[joint].lane(0))
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
        let dynamics = dynamics(structure, robot, &q, &qd);
        let qd = lanes(&qd);
        let mut qdd = qd;
        Lane::run(Accelerations {
            structure,
            model: &Model::splat(structure, robot),
            dynamics: &dynamics,
            qd: &qd,
            torque: &lanes(&torque),
            step: Lane::splat(0.0),
            qdd: &mut qdd,
        });
        Joints::from_fn(q.len(), |joint| qdd[joint].lane(0))
    })
}

fn dynamics<S: Structure<N>, const N: usize>(
    structure: S,
    robot: &Robot,
    q: &Joints<f64>,
    qd: &Joints<f64>,
) -> Dynamics<Lane, N> {
    let mut dynamics = Dynamics::zero();
    let mut at_q = [Turn::none(); N];
    let model = &Model::splat(structure, robot);
    structure.turns(model, &lanes(q), &mut at_q);
    let (turns, qd) = (&at_q, &lanes(qd));
    Lane::run(MassMatrixAndBias { structure, model, turns, qd, dynamics: &mut dynamics });
    dynamics
}

fn lanes<const N: usize>(values: &Joints<f64>) -> [Lane; N] {
    let mut lanes = [Lane::splat(0.0); N];
    for (lane, &value) in lanes.iter_mut().zip(values) {
        *lane = Lane::splat(value);
    }
    lanes
}
