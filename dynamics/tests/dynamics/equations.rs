//! The equation of motion of random arms against Newton's and Euler's laws, written down plainly.
//!
//! The kernels work in link frames with spatial inertias, composite bodies and a factorization. Here
//! every body is followed in the base's frame, and every torque is a sum of moments over all bodies
//! beyond the joint.

use std::f64::consts::FRAC_PI_2;

use dynamics::{
    Joints, Kinematics, RigidBody, Robot, bias_forces, forward_dynamics, gravity, mass_matrix,
};
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector3};
use proptest::prelude::*;
use serde_json::{Value, json};
use spec::JOINTS;

use super::{run, spec};

const TWISTS: Joints<f64> =
    [0.0, -FRAC_PI_2, FRAC_PI_2, FRAC_PI_2, -FRAC_PI_2, FRAC_PI_2, FRAC_PI_2];

/// A link in the base's frame.
struct Body {
    /// Of the joint that carries it.
    axis: Vector3<f64>,
    origin: Vector3<f64>,
    mass: f64,
    com: Vector3<f64>,
    /// About the centre of mass.
    inertia: Matrix3<f64>,
    com_velocity: Vector3<f64>,
    angular_velocity: Vector3<f64>,
    force: Vector3<f64>,
    moment: Vector3<f64>,
}

fn bodies(robot: &Robot, q: Joints<f64>, qd: Joints<f64>, qdd: Joints<f64>) -> Vec<Body> {
    let mut rotation = Rotation3::identity();
    let mut origin = Vector3::zeros();
    let mut w = Vector3::zeros();
    let mut w_dot = Vector3::zeros();
    let mut velocity = Vector3::zeros();
    // A base that accelerates upwards feels like gravity.
    let mut acceleration = Vector3::new(0.0, 0.0, robot.gravity);
    let mut bodies = Vec::new();
    for joint in 0..JOINTS {
        let Kinematics { a_m, d_m, .. } = robot.kinematics;
        let twist = Rotation3::from_axis_angle(&Vector3::x_axis(), TWISTS[joint]);
        let arm = rotation * (twist * Vector3::new(a_m[joint], 0.0, d_m[joint]));
        velocity += w.cross(&arm);
        acceleration += w_dot.cross(&arm) + w.cross(&w.cross(&arm));
        origin += arm;
        rotation = rotation * twist * Rotation3::from_axis_angle(&Vector3::z_axis(), q[joint]);
        let axis = rotation * Vector3::z();
        w_dot += axis * qdd[joint] + w.cross(&axis) * qd[joint];
        w += axis * qd[joint];

        let link = &robot.links[joint];
        let offset = rotation * Vector3::from(link.com);
        let inertia = Matrix3::from_fn(|row, column| link.inertia[row][column]);
        let inertia = rotation.matrix() * inertia * rotation.matrix().transpose();
        let com_acceleration = acceleration + w_dot.cross(&offset) + w.cross(&w.cross(&offset));
        bodies.push(Body {
            axis,
            origin,
            mass: link.mass,
            com: origin + offset,
            inertia,
            com_velocity: velocity + w.cross(&offset),
            angular_velocity: w,
            force: com_acceleration * link.mass,
            moment: inertia * w_dot + w.cross(&(inertia * w)),
        });
    }
    bodies
}

/// Torques that make the arm accelerate by `qdd`, without damping and friction.
fn inverse_dynamics(
    robot: &Robot,
    q: Joints<f64>,
    qd: Joints<f64>,
    qdd: Joints<f64>,
) -> Joints<f64> {
    let bodies = bodies(robot, q, qd, qdd);
    std::array::from_fn(|joint| {
        let Body { axis, origin, .. } = &bodies[joint];
        let moment: Vector3<f64> = bodies[joint..]
            .iter()
            .map(|body| (body.com - origin).cross(&body.force) + body.moment)
            .sum();
        axis.dot(&moment) + robot.armature[joint] * qdd[joint]
    })
}

/// Kinetic and potential energy, that of the rotors included, J.
fn energies(robot: &Robot, q: Joints<f64>, qd: Joints<f64>) -> (f64, f64) {
    let (mut kinetic, mut potential) = (0.0, 0.0);
    for body in bodies(robot, q, qd, [0.0; JOINTS]) {
        let spin = body.angular_velocity.dot(&(body.inertia * body.angular_velocity));
        kinetic += 0.5 * (body.mass * body.com_velocity.norm_squared() + spin);
        potential += body.mass * robot.gravity * body.com.z;
    }
    for (armature, qd) in robot.armature.iter().zip(qd) {
        kinetic += 0.5 * armature * qd * qd;
    }
    (kinetic, potential)
}

prop_compose! {
    /// Any mass distribution the size of an arm's link.
    fn body()(
        mass in 0.1..8.0f64,
        com in prop::array::uniform3(-0.2..0.2f64),
        root in prop::array::uniform9(-0.15..0.15f64),
    ) -> RigidBody {
        let root = Matrix3::from_row_slice(&root);
        let moments = (root * root.transpose() + Matrix3::identity() * 1e-4) * mass;
        let inertia = Matrix3::identity() * moments.trace() - moments;
        RigidBody {
            mass,
            com,
            inertia: std::array::from_fn(|row| std::array::from_fn(|column| inertia[(row, column)])),
        }
    }
}

prop_compose! {
    fn robot()(
        links in prop::array::uniform7(body()),
        damping in prop::array::uniform7(0.0..30.0f64),
        armature in prop::array::uniform7(0.0..0.05f64),
        [a4, a5, a7, d1, d3, d5, flange_m] in prop::array::uniform7(-0.5..0.5f64),
        gravity in prop_oneof![Just(0.0), 0.0..20.0f64],
    ) -> Robot {
        let kinematics = Kinematics {
            a_m: [0.0, 0.0, 0.0, a4, a5, 0.0, a7],
            d_m: [d1, 0.0, d3, 0.0, d5, 0.0, 0.0],
            flange_m,
        };
        Robot { links, damping, armature, kinematics, friction: None, payload: None, gravity }
    }
}

fn values(limit: f64) -> impl Strategy<Value = Joints<f64>> {
    prop::array::uniform7(-limit..limit)
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()))
}

fn relative_error(values: &[f64], expected: &[f64]) -> f64 {
    let differences: Vec<f64> = values.iter().zip(expected).map(|(a, b)| a - b).collect();
    largest(&differences) / largest(expected).max(1e-300)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn the_torque_that_makes_an_acceleration_is_the_torque_that_was_applied(
        robot in robot(), q in values(6.0), qd in values(5.0), torque in values(50.0),
    ) {
        let qdd = forward_dynamics(&robot, q, qd, torque);
        let needed = inverse_dynamics(&robot, q, qd, qdd);
        let applied: Joints<f64> =
            std::array::from_fn(|joint| torque[joint] - robot.damping[joint] * qd[joint]);
        // Inertial and bias torques cancel down to the applied one, and are the measure of rounding.
        let bias = bias_forces(&robot, q, qd);
        let scale = largest(&applied) + largest(&bias);
        let residual: Vec<f64> = needed.iter().zip(applied).map(|(a, b)| a - b).collect();
        prop_assert!(largest(&residual) < 1e-12 * scale, "{:e}", largest(&residual) / scale);
    }

    #[test]
    fn bias_forces_are_the_torques_of_unaccelerated_motion(
        robot in robot(), q in values(6.0), qd in values(5.0),
    ) {
        let expected = inverse_dynamics(&robot, q, qd, [0.0; JOINTS]);
        prop_assert!(relative_error(&bias_forces(&robot, q, qd), &expected) < 1e-12);
    }

    #[test]
    fn the_mass_matrix_is_positive_definite_and_its_columns_are_torques_of_unit_accelerations(
        robot in robot(), q in values(6.0),
    ) {
        let m = mass_matrix(&robot, q);
        let matrix = SMatrix::<f64, 7, 7>::from_fn(|row, column| m[row][column]);
        prop_assert_eq!(matrix, matrix.transpose());
        prop_assert!(matrix.cholesky().is_some());
        let weightless = Robot { gravity: 0.0, ..robot };
        for joint in 0..JOINTS {
            let mut unit = [0.0; JOINTS];
            unit[joint] = 1.0;
            let column = inverse_dynamics(&weightless, q, [0.0; JOINTS], unit);
            prop_assert!(relative_error(&m[joint], &column) < 1e-12);
        }
    }

    #[test]
    fn the_mass_matrix_holds_the_kinetic_energy_and_gravity_is_the_slope_of_the_potential(
        robot in robot(), q in values(6.0), qd in values(5.0),
    ) {
        let (kinetic, potential) = energies(&robot, q, qd);
        let m = mass_matrix(&robot, q);
        let matrix = SMatrix::<f64, 7, 7>::from_fn(|row, column| m[row][column]);
        let velocity = SVector::from(qd);
        let expected = 0.5 * velocity.dot(&(matrix * velocity));
        prop_assert!((kinetic / expected - 1.0).abs() < 1e-12);

        let torques = gravity(&robot, q);
        for joint in 0..JOINTS {
            let moved = |by: f64| {
                let mut q = q;
                q[joint] += by;
                energies(&robot, q, qd).1
            };
            let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            prop_assert!((slope - torques[joint]).abs() < 1e-6 * (1.0 + potential.abs()));
        }
    }
}

/// The largest change of the energy of arms that nothing drives or brakes, relative to what moves,
/// over half a second.
fn energy_drift(integrator: &Value, gravity: &str) -> f64 {
    let still = json!({"multisine": {
        "frequency_hz": {"fixed": 0.1}, "amplitude_nm_per_hz": [0, 0],
    }});
    let spec = spec(
        &still,
        &json!({
            "samples": 31,
            "precision": "f64",
            "integrator": integrator,
            "robot": {"damping_nm_s_rad": vec![0.0; JOINTS], "gravity": gravity, "geometry_fraction": 0.1},
            // Fast, so that the errors of the schemes stand out from the rounding of what is recorded.
            "initial_state": {"velocity_scale": [1, 1], "joint1_velocity_rad_s": 5, "velocity_rad_s": 8},
            "observations": {"joint_velocities": true},
            "rejection": {"position_margin_rad": null},
        }),
    );
    let trajectories = run(&spec, 0..16);
    let qd = trajectories.qd.as_ref().unwrap();
    let mut worst: f64 = 0.0;
    for (row, scenario) in trajectories.scenarios.iter().enumerate() {
        let energies_at = |k: usize| {
            let at = |series: &[f32]| series.as_chunks::<JOINTS>().0[row * 31 + k].map(f64::from);
            energies(&scenario.robot, at(&trajectories.q), at(qd))
        };
        let (kinetic, potential) = energies_at(0);
        let moving = (0..31).map(|k| energies_at(k).0).fold(0.0, f64::max);
        for k in 1..31 {
            let (later_kinetic, later_potential) = energies_at(k);
            let drift = (later_kinetic - kinetic) + (later_potential - potential);
            worst = worst.max((drift / moving).abs());
        }
    }
    worst
}

#[test]
fn energy_is_conserved_without_damping_and_torque_to_the_order_of_each_scheme() {
    for gravity in ["off", "on"] {
        let extrapolated = |order| json!({"scheme": "extrapolated", "order": order});
        for (scheme, order, coarse) in [
            (extrapolated(2), 2.0, 16),
            (extrapolated(3), 3.0, 8),
            (extrapolated(4), 4.0, 4),
            (json!({"scheme": "rk4"}), 4.0, 2),
        ] {
            let drift = |substeps: u32| {
                let mut integrator = scheme.clone();
                integrator["substeps"] = json!(substeps);
                energy_drift(&integrator, gravity)
            };
            let (coarse_drift, fine_drift) = (drift(coarse), drift(2 * coarse));
            let observed = (coarse_drift / fine_drift).log2();
            println!(
                "gravity {gravity}, {scheme}: {coarse_drift:.1e}, {fine_drift:.1e}, order {observed:.2}"
            );
            assert!(
                (observed - order).abs() < 0.4,
                "{scheme}, gravity {gravity}: order {observed}"
            );
            assert!(fine_drift < 1e-3);
        }
    }
}
