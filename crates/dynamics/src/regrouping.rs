//! Groups inertial parameters with the same effect.
//!
//! A body that is symmetric about a joint's axis, and has no inertia about it, moves the same arm in
//! the same way whether the link beyond the joint carries it or the link before. Every link can give
//! up one such body: all of its mass, its first moment along the axis, and as much inertia as makes one
//! of the entries across the axis zero. Two first moments and five inertias of a link remain: the
//! base parameters of Gautier and Khalil 1990, "Direct calculation of minimum set of
//! inertial parameters of serial robots". The equation of motion is the same to the last symbol, and
//! takes a fifth fewer operations.

use nalgebra::{Matrix3, Vector3};

use crate::{Joints, Robot};

/// Regrouped inertial parameters of a link with respect to the origin of its frame. In this frame
/// spatial inertias add, so the parallel-axis theorem is not needed. All other parameters are zero.
#[derive(Clone, Copy, Default)]
pub(crate) struct Link<L> {
    /// Mass times x and y of the centre of mass.
    pub(crate) first_moment: [L; 2],
    /// Entries xx, xy, xz, yz, zz.
    pub(crate) inertia: [L; 5],
}

/// A body as seen from the origin of a frame.
#[derive(Clone, Copy, Default)]
struct Inertia {
    mass: f64,
    first_moment: Vector3<f64>,
    about_origin: Matrix3<f64>,
}

/// The links of a robot. Each has given up the body that the link before it carries instead.
#[inline(never)]
pub(crate) fn regrouped(robot: &Robot) -> Joints<Link<f64>> {
    let mut links = robot.links.map(|body| {
        let [xx, xy, xz, yy, yz, zz] = body.inertia_about_origin();
        Inertia {
            mass: body.mass,
            first_moment: Vector3::from(body.com) * body.mass,
            about_origin: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
        }
    });
    for joint in (1..links.len()).rev() {
        let link = &mut links[joint];
        let (mass, along) = (link.mass, link.first_moment.z);
        let across = link.about_origin.m22;
        link.mass = 0.0;
        link.first_moment.z = 0.0;
        link.about_origin -= Matrix3::from_diagonal(&Vector3::new(across, across, 0.0));

        let axis = axis_in_parent(robot, joint);
        let moment = axis * along;
        let origin = Vector3::from(robot.kinematics.joint_origin(joint));
        let about_joint = (Matrix3::identity() - axis * axis.transpose()) * across;
        let mixed = origin * moment.transpose();
        let shift = Matrix3::identity() * (2.0 * origin.dot(&moment)) - mixed - mixed.transpose()
            + (Matrix3::identity() * origin.norm_squared() - origin * origin.transpose()) * mass;
        let parent = &mut links[joint - 1];
        parent.mass += mass;
        parent.first_moment += moment + origin * mass;
        parent.about_origin += about_joint + shift;
    }
    links.map(|Inertia { first_moment, about_origin: i, .. }| Link {
        first_moment: [first_moment.x, first_moment.y],
        inertia: [i.m11, i.m12, i.m13, i.m23, i.m33],
    })
}

/// The axis of a joint in the frame of the link before it.
fn axis_in_parent(robot: &Robot, joint: usize) -> Vector3<f64> {
    let twist = robot.kinematics.twists[joint];
    Vector3::new(0.0, -twist.sin, twist.cos)
}
