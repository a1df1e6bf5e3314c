//! The dynamics of one robot in f64, for baselines, figures and tests.
//!
//! The same code as on vectors, with one lane.

use simd::{F64Array, Lanes};
use spec::JOINTS;

use crate::forward_dynamics::{Dynamics, turns};
use crate::kernels::Kernels;
use crate::model::Model;
use crate::spatial::Turn;
use crate::{Joints, Robot};

type Lane = F64Array<1>;

/// M(q) + A, symmetric positive definite, kg·m²; `q` in rad.
pub fn mass_matrix(robot: &Robot, q: Joints<f64>) -> Joints<Joints<f64>> {
    let dynamics = dynamics(robot, q, [0.0; JOINTS]);
    std::array::from_fn(|row| {
        std::array::from_fn(|column| dynamics.mass_matrix[row.max(column)][row.min(column)].lane(0))
    })
}

/// C(q, q̇) q̇ + g(q), N·m; `q` in rad, `qd` in rad/s. Damping and friction are not part of it.
pub fn bias_forces(robot: &Robot, q: Joints<f64>, qd: Joints<f64>) -> Joints<f64> {
    dynamics(robot, q, qd).bias.map(|bias| bias.lane(0))
}

/// g(q), N·m: the torques that hold the arm still at `q` (rad).
pub fn gravity(robot: &Robot, q: Joints<f64>) -> Joints<f64> {
    bias_forces(robot, q, [0.0; JOINTS])
}

/// q̈ in rad/s² under `torque` (N·m), damping and friction included.
pub fn forward_dynamics(
    robot: &Robot,
    q: Joints<f64>,
    qd: Joints<f64>,
    torque: Joints<f64>,
) -> Joints<f64> {
    let mut qdd = lanes(qd);
    let dynamics = dynamics(robot, q, qd);
    let explicit = Lane::splat(0.0);
    Lane::accelerations(
        &Model::splat(robot),
        &dynamics,
        &lanes(qd),
        &lanes(torque),
        explicit,
        &mut qdd,
    );
    qdd.map(|qdd| qdd.lane(0))
}

fn dynamics(robot: &Robot, q: Joints<f64>, qd: Joints<f64>) -> Dynamics<Lane> {
    let mut dynamics = Dynamics::zero();
    let mut at_q = [Turn::none(); JOINTS];
    turns(&lanes(q), &mut at_q);
    Lane::mass_matrix_and_bias(&Model::splat(robot), &at_q, &lanes(qd), &mut dynamics);
    dynamics
}

fn lanes(values: Joints<f64>) -> Joints<Lane> {
    values.map(Lane::splat)
}
