//! Compares the equation of motion of random arms with Newton's and Euler's laws in their plain
//! form.
//!
//! The kernels work in link frames with spatial inertias, composite bodies and a factorization.
//! Here every body is described in the world, and every torque is a sum of moments over all
//! bodies behind the joint.

use dynamics::{
    Angle, Base, Joints, Kinematics, RigidBody, Robot, Row, bias_forces, forward_dynamics, gravity,
    mass_matrix,
};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};
use proptest::prelude::*;
use serde_json::{Value, json};
use spec::MAX_JOINTS;

use super::{run, spec};

use crate::JOINTS;

/// A link in the world.
struct Body {
    /// Axis of the joint that carries the link.
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
    let Kinematics { base, joints, .. } = robot.kinematics;
    let base_axes = Matrix3::from_fn(|row, column| base.rotation[row][column]);
    let mut rotation = Rotation3::from_matrix_unchecked(base_axes);
    let mut origin = Vector3::from(base.position_m);
    let mut w = Vector3::zeros();
    let mut w_dot = Vector3::zeros();
    let mut velocity = Vector3::zeros();
    // A base that accelerates upwards feels like gravity.
    let mut acceleration = Vector3::new(0.0, 0.0, robot.gravity);
    let mut bodies = Vec::new();
    for joint in 0..robot.joints() {
        let Row { a_m, d_m, twist, offset, shift_m } = joints[joint];
        let twist = Rotation3::from_axis_angle(&Vector3::x_axis(), twist.sin.atan2(twist.cos));
        let arm = rotation * (Vector3::from(shift_m) + twist * Vector3::new(a_m, 0.0, d_m));
        let angle = q[joint] + offset.sin.atan2(offset.cos);
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), angle);
        velocity += w.cross(&arm);
        acceleration += w_dot.cross(&arm) + w.cross(&w.cross(&arm));
        origin += arm;
        rotation = rotation * twist * turn;
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

/// Torques for the acceleration `qdd`, without damping and friction.
fn inverse_dynamics(
    robot: &Robot,
    q: Joints<f64>,
    qd: Joints<f64>,
    qdd: Joints<f64>,
) -> Joints<f64> {
    let bodies = bodies(robot, q, qd, qdd);
    Joints::from_fn(bodies.len(), |joint| {
        let Body { axis, origin, .. } = &bodies[joint];
        let moment: Vector3<f64> = bodies[joint..]
            .iter()
            .map(|body| (body.com - origin).cross(&body.force) + body.moment)
            .sum();
        axis.dot(&moment) + robot.armature[joint] * qdd[joint]
    })
}

/// Kinetic energy with that of the rotors, and potential energy, J.
fn energies(robot: &Robot, q: Joints<f64>, qd: Joints<f64>) -> (f64, f64) {
    let (mut kinetic, mut potential) = (0.0, 0.0);
    for body in bodies(robot, q, qd, Joints::splat(q.len(), 0.0)) {
        let spin = body.angular_velocity.dot(&(body.inertia * body.angular_velocity));
        kinetic += 0.5 * (body.mass * body.com_velocity.norm_squared() + spin);
        potential += body.mass * robot.gravity * body.com.z;
    }
    for (armature, qd) in robot.armature.iter().zip(&qd) {
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

/// A joint: its row of the table (a, α in degrees, d, offset in degrees, shift), link, damping and
/// armature.
type JointRow = ((f64, f64, f64, f64, [f64; 3]), RigidBody, f64, f64);

fn proper_row(a: f64, alpha_deg: f64, d: f64) -> impl Strategy<Value = JointRow> {
    let place = (-a..=a, Just(alpha_deg), -d..=d, Just(0.0), Just([0.0; 3]));
    (place, body(), 0.0..30.0f64, 0.0..0.05f64)
}

fn any_row() -> impl Strategy<Value = JointRow> {
    let angle =
        || prop_oneof![prop::sample::select(vec![-90.0, 0.0, 45.0, 90.0, 180.0]), -180.0..180.0f64];
    let shift = prop_oneof![Just([0.0; 3]), prop::array::uniform3(-0.5..0.5f64)];
    let place = (-0.5..=0.5, angle(), -0.5..=0.5, prop_oneof![Just(0.0), angle()], shift);
    (place, body(), 0.0..30.0f64, 0.0..0.05f64)
}

/// A robot of any structure or of the compiled one, its positions, velocities and two more sets of
/// values of its joints.
fn moving_robot() -> impl Strategy<Value = (Robot, [Joints<f64>; 3])> {
    let chains = prop::collection::vec(any_row(), 1..=MAX_JOINTS).boxed();
    let compiled = [
        (0.0, 0.0, 0.5),
        (0.0, -90.0, 0.0),
        (0.0, 90.0, 0.5),
        (0.5, 90.0, 0.0),
        (0.5, -90.0, 0.5),
        (0.0, 90.0, 0.0),
        (0.5, 90.0, 0.0),
    ]
    .map(|(a, alpha, d)| proper_row(a, alpha, d).boxed());
    let compiled = compiled.to_vec().boxed();
    let tilted = (prop::array::uniform3(-2.0..2.0f64), prop::array::uniform3(-180.0..180.0f64));
    let base = prop_oneof![Just(([0.0; 3], [0.0; 3])), tilted];
    let gravity = prop_oneof![Just(0.0), 0.0..20.0f64];
    let states = prop::collection::vec((-6.0..6.0f64, -5.0..5.0f64, -50.0..50.0f64), MAX_JOINTS);
    (prop_oneof![chains, compiled], base, gravity, -0.5..0.5f64, states).prop_map(
        |(rows, base, gravity, flange_m, states)| {
            let joint = |row: &JointRow| {
                let (a_m, alpha_deg, d_m, offset_deg, shift_m) = row.0;
                let [twist, offset] = [alpha_deg, offset_deg].map(Angle::degrees);
                Row { a_m, d_m, twist, offset, shift_m }
            };
            let kinematics = Kinematics {
                base: Base::new(base.0, base.1),
                joints: rows.iter().map(joint).collect(),
                hand: Row { d_m: flange_m, ..Row::default() },
            };
            let robot = Robot {
                links: rows.iter().map(|row| row.1).collect(),
                damping: rows.iter().map(|row| row.2).collect(),
                armature: rows.iter().map(|row| row.3).collect(),
                kinematics,
                friction: None,
                payload: None,
                gravity,
            };
            let states = || states.iter().take(rows.len());
            let q = states().map(|state| state.0).collect();
            let qd = states().map(|state| state.1).collect();
            (robot, [q, qd, states().map(|state| state.2).collect()])
        },
    )
}

fn matrix(m: &Joints<Joints<f64>>) -> DMatrix<f64> {
    DMatrix::from_fn(m.len(), m.len(), |row, column| m[row][column])
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
        (robot, [q, qd, torque]) in moving_robot(),
    ) {
        let qdd = forward_dynamics(&robot, q, qd, torque);
        let needed = inverse_dynamics(&robot, q, qd, qdd);
        let applied: Joints<f64> =
            Joints::from_fn(q.len(), |joint| torque[joint] - robot.damping[joint] * qd[joint]);
        // Inertial and bias torques cancel down to the applied one, so they set the scale of
        // rounding errors.
        let bias = bias_forces(&robot, q, qd);
        let scale = largest(&applied) + largest(&bias);
        let residual: Vec<f64> = needed.iter().zip(&applied).map(|(a, b)| a - b).collect();
        prop_assert!(largest(&residual) < 1e-12 * scale, "{:e}", largest(&residual) / scale);
    }

    #[test]
    fn bias_forces_are_the_torques_of_unaccelerated_motion(
        (robot, [q, qd, _]) in moving_robot(),
    ) {
        let expected = inverse_dynamics(&robot, q, qd, Joints::splat(q.len(), 0.0));
        // Torques of a short chain may cancel. Their terms are at least of the order of 1 N·m.
        let bias = bias_forces(&robot, q, qd);
        let differences: Vec<f64> = bias.iter().zip(&expected).map(|(a, b)| a - b).collect();
        prop_assert!(largest(&differences) < 1e-12 * (1.0 + largest(&expected)));
    }

    #[test]
    fn the_mass_matrix_is_positive_definite_and_its_columns_are_torques_of_unit_accelerations(
        (robot, [q, ..]) in moving_robot(),
    ) {
        let m = mass_matrix(&robot, q);
        let matrix = matrix(&m);
        prop_assert_eq!(&matrix, &matrix.transpose());
        prop_assert!(matrix.cholesky().is_some());
        let weightless = Robot { gravity: 0.0, ..robot };
        for joint in 0..q.len() {
            let still = Joints::splat(q.len(), 0.0);
            let mut unit = still;
            unit[joint] = 1.0;
            let column = inverse_dynamics(&weightless, q, still, unit);
            prop_assert!(relative_error(&m[joint], &column) < 1e-12);
        }
    }

    #[test]
    fn the_mass_matrix_holds_the_kinetic_energy_and_gravity_is_the_slope_of_the_potential(
        (robot, [q, qd, _]) in moving_robot(),
    ) {
        let (kinetic, potential) = energies(&robot, q, qd);
        let m = mass_matrix(&robot, q);
        let velocity = DVector::from_column_slice(&qd);
        let expected = 0.5 * velocity.dot(&(matrix(&m) * &velocity));
        prop_assert!((kinetic / expected - 1.0).abs() < 1e-12);

        let torques = gravity(&robot, q);
        for joint in 0..q.len() {
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

/// The largest relative change of the energy over half a second, for arms without drive and brake.
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
            // The arms are fast, so that errors of the schemes exceed the rounding of the recorded
            // values.
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
            let at = |series: &[f32]| -> Joints<f64> {
                series.as_chunks::<JOINTS>().0[row * 31 + k].map(f64::from).into()
            };
            energies(&scenario.robot, at(trajectories.series.y()), at(qd))
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
