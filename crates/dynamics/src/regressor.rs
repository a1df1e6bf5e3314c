//! The torques of a motion, linear in the links' inertial parameters.
//!
//! `(M(q) + A) q̈ + C(q, q̇) q̇ + g(q) = Y(q, q̇, q̈) π + A q̈` with the parameters π of all links. An
//! identification of an arm from measured torques is a regression on Y (Atkeson, An and Hollerbach
//! 1986, "Estimation of inertial parameters of manipulator loads and links").

use nalgebra::{Matrix3, Rotation3, Vector3};
use spec::MAX_JOINTS;

use crate::{Joints, Kinematics, RigidBody};

/// Parameters of a link: mass (kg), first moments x, y, z (kg·m), inertia xx, xy, xz, yy, yz, zz
/// about the origin of its frame (kg·m²).
pub const LINK_PARAMETERS: usize = 10;

impl RigidBody {
    /// The parameters in which torques are linear, see [`LINK_PARAMETERS`].
    pub fn parameters(&self) -> [f64; LINK_PARAMETERS] {
        let [xx, xy, xz, yy, yz, zz] = self.inertia_about_origin();
        let [hx, hy, hz] = self.com.map(|coordinate| self.mass * coordinate);
        [self.mass, hx, hy, hz, xx, xy, xz, yy, yz, zz]
    }

    /// The body with these parameters. Its mass must not be zero.
    pub fn from_parameters(parameters: &[f64; LINK_PARAMETERS]) -> Self {
        let [mass, hx, hy, hz, inertia @ ..] = *parameters;
        let com = [hx, hy, hz].map(|moment| moment / mass);
        let about_origin = Self::new(mass, com, inertia);
        let [xx, xy, xz, yy, yz, zz] = Self::new(mass, com, [0.0; 6]).inertia_about_origin();
        let shift = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let inertia = std::array::from_fn(|row| {
            std::array::from_fn(|column| about_origin.inertia[row][column] - shift[row][column])
        });
        Self { inertia, ..about_origin }
    }
}

/// A force and a moment about a frame's origin.
#[derive(Clone, Copy)]
struct Wrench {
    force: Vector3<f64>,
    moment: Vector3<f64>,
}

/// Computes Y at positions `q` (rad), velocities `qd` (rad/s) and accelerations `qdd` (rad/s²), and
/// writes it to `regressor`, `[joint, link, parameter]` in row-major order.
///
/// `gravity` is in m/s², downwards in the world; 0 when gravity is off.
///
/// # Panics
/// If `regressor` does not have joints² · [`LINK_PARAMETERS`] elements.
pub fn torque_regressor(
    kinematics: &Kinematics,
    gravity: f64,
    q: &Joints<f64>,
    qd: &Joints<f64>,
    qdd: &Joints<f64>,
    regressor: &mut [f64],
) {
    let joints = kinematics.joints.len();
    let width = joints * LINK_PARAMETERS;
    assert_eq!(regressor.len(), joints * width, "joints² × {LINK_PARAMETERS} elements");
    regressor.fill(0.0);

    let mut turns = [Rotation3::identity(); MAX_JOINTS];
    let mut origins = [Vector3::zeros(); MAX_JOINTS];
    let (mut w, mut w_dot) = (Vector3::zeros(), Vector3::zeros());
    let mut acceleration = Vector3::from(kinematics.base.up()) * gravity;
    for link in 0..joints {
        let row = &kinematics.joints[link];
        turns[link] = row.turn(q[link]);
        origins[link] = Vector3::from(row.origin());
        acceleration += w_dot.cross(&origins[link]) + w.cross(&w.cross(&origins[link]));
        let to_link = turns[link].inverse();
        (w, w_dot, acceleration) = (to_link * w, to_link * w_dot, to_link * acceleration);
        let spin = Vector3::z() * qd[link];
        w_dot += w.cross(&spin) + Vector3::z() * qdd[link];
        w += spin;

        let mut wrenches = wrenches_of_parameters(&w, &w_dot, &acceleration);
        for joint in (0..=link).rev() {
            let columns = joint * width + link * LINK_PARAMETERS;
            for (entry, wrench) in regressor[columns..].iter_mut().zip(&wrenches) {
                *entry = wrench.moment.z;
            }
            for wrench in &mut wrenches {
                let force = turns[joint] * wrench.force;
                let moment = turns[joint] * wrench.moment + origins[joint].cross(&force);
                *wrench = Wrench { force, moment };
            }
        }
    }
}

/// The wrenches that each parameter's unit needs for a motion of the link's frame.
fn wrenches_of_parameters(
    w: &Vector3<f64>,
    w_dot: &Vector3<f64>,
    acceleration: &Vector3<f64>,
) -> [Wrench; LINK_PARAMETERS] {
    /// The row and column of each entry of the inertia.
    const ENTRIES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

    std::array::from_fn(|parameter| match parameter {
        0 => Wrench { force: *acceleration, moment: Vector3::zeros() },
        1..=3 => {
            let mut arm = Vector3::zeros();
            arm[parameter - 1] = 1.0;
            let force = w_dot.cross(&arm) + w.cross(&w.cross(&arm));
            Wrench { force, moment: arm.cross(acceleration) }
        }
        _ => {
            let (row, column) = ENTRIES[parameter - 4];
            let mut inertia = Matrix3::zeros();
            inertia[(row, column)] = 1.0;
            inertia[(column, row)] = 1.0;
            let moment = inertia * w_dot + w.cross(&(inertia * w));
            Wrench { force: Vector3::zeros(), moment }
        }
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::angle::Angle;
    use crate::kinematics::{Base, Row};
    use crate::{Robot, bias_forces, mass_matrix};

    /// The Panda on a tilted base, with joints that no proper table has.
    fn odd_panda() -> Robot {
        let mut robot = Robot { gravity: 9.81, ..Robot::panda() };
        robot.kinematics.base = Base::new([0.1, 0.2, 0.3], [30.0, -50.0, 20.0]);
        for (joint, row) in robot.kinematics.joints.iter_mut().enumerate() {
            *row = Row {
                offset: Angle::degrees(40.0 * joint as f64),
                shift_m: [0.01, -0.02, 0.03 * joint as f64],
                ..*row
            };
        }
        robot
    }

    proptest! {
        #[test]
        fn the_regressor_times_the_parameters_is_the_torque_of_the_motion(
            values in prop::collection::vec(-3.0..3.0f64, 21),
            is_odd: bool,
        ) {
            let robot =
                if is_odd { odd_panda() } else { Robot { gravity: 9.81, ..Robot::panda() } };
            let [q, qd, qdd] = [0, 7, 14].map(|at| Joints::from(&values[at..at + 7]));
            let mut regressor = vec![0.0; 7 * 7 * LINK_PARAMETERS];
            torque_regressor(&robot.kinematics, robot.gravity, &q, &qd, &qdd, &mut regressor);
            let parameters: Vec<f64> =
                robot.links.iter().flat_map(RigidBody::parameters).collect();
            let (mass, bias) = (mass_matrix(&robot, q), bias_forces(&robot, q, qd));
            for joint in 0..7 {
                let row = &regressor[joint * 70..][..70];
                let torque: f64 = row.iter().zip(&parameters).map(|(y, pi)| y * pi).sum();
                let of_links: f64 = mass[joint].iter().zip(&qdd).map(|(m, qdd)| m * qdd).sum();
                let expected = of_links - robot.armature[joint] * qdd[joint] + bias[joint];
                prop_assert!((torque - expected).abs() < 1e-11, "{torque} {expected}");
            }
        }
    }

    #[test]
    fn parameters_and_bodies_determine_each_other() {
        for body in Robot::panda().links.iter() {
            let again = RigidBody::from_parameters(&body.parameters());
            assert!((again.mass - body.mass).abs() < 1e-14);
            for axis in 0..3 {
                assert!((again.com[axis] - body.com[axis]).abs() < 1e-14);
                for column in 0..3 {
                    let difference = again.inertia[axis][column] - body.inertia[axis][column];
                    assert!(difference.abs() < 1e-14);
                }
            }
        }
    }
}
