//! The constants of moving robots: their parameters, one robot per lane.
//!
//! Inertial parameters with the same effect are grouped. A body that is symmetric about a joint's
//! axis, and has no inertia about it, moves the same arm in the same way whether the link beyond the
//! joint carries it or the link before. Every link can give up one such body: all of its mass, its
//! first moment along the axis, and as much inertia as makes one of the entries across the axis
//! zero. Two first moments and five inertias of a link remain: the base parameters of Gautier and
//! Khalil 1990, "Direct calculation of minimum set of inertial parameters of serial robots". The
//! equation of motion is the same to the last symbol, and takes a fifth fewer operations.

use nalgebra::{Matrix3, Vector3};
use simd::Lanes;

use crate::friction::Sigmoids;
use crate::spatial::Turn;
use crate::structure::Structure;
use crate::{Joints, Robot};

/// The constants of moving robots: their parameters, one robot per lane.
pub(crate) struct Model<L, const N: usize> {
    pub(crate) links: [Link<L>; N],
    /// Origin of each joint, in the frame of the link before it.
    pub(crate) origins: [[L; 3]; N],
    /// Twists about x of the frame before. Compiled structures do not read them.
    pub(crate) twists: [Turn<L>; N],
    /// Turns of the joints at position 0. Compiled structures do not read them.
    pub(crate) offsets: [Turn<L>; N],
    pub(crate) damping: [L; N],
    pub(crate) armature: [L; N],
    /// `None` when no robot has any.
    pub(crate) friction: Option<Sigmoids<L, N>>,
    /// Acceleration of the base in its own axes, upwards in the world. A robot at rest under gravity
    /// feels the same.
    pub(crate) base_acceleration: [L; 3],
}

impl<L: Lanes, const N: usize> Model<L, N> {
    /// The same robot in every lane.
    #[inline(always)]
    pub(crate) fn splat(structure: impl Structure<N>, robot: &Robot) -> Self {
        let zero = L::splat(0.0);
        let link = Link { first_moment: [zero; 2], inertia: [zero; 5] };
        let mut model = Self {
            links: [link; N],
            origins: [[zero; 3]; N],
            twists: [Turn::none(); N],
            offsets: [Turn::none(); N],
            damping: [zero; N],
            armature: [zero; N],
            friction: None,
            base_acceleration: [zero; 3],
        };
        for lane in 0..L::LANES {
            model.set_lane(structure, lane, robot);
        }
        model
    }

    #[inline(always)]
    pub(crate) fn set_lane(&mut self, structure: impl Structure<N>, lane: usize, robot: &Robot) {
        for (acceleration, up) in self.base_acceleration.iter_mut().zip(robot.kinematics.base.up())
        {
            acceleration.set_lane(lane, robot.gravity * up);
        }
        let regrouped = regrouped(robot);
        for joint in 0..structure.joints() {
            let row = &robot.kinematics.joints[joint];
            self.twists[joint].set_lane(lane, row.twist);
            self.offsets[joint].set_lane(lane, row.offset);
            self.damping[joint].set_lane(lane, robot.damping[joint]);
            self.armature[joint].set_lane(lane, robot.armature[joint]);
            for (coordinate, value) in self.origins[joint].iter_mut().zip(row.origin()) {
                coordinate.set_lane(lane, value);
            }
            let (regrouped, link) = (&regrouped[joint], &mut self.links[joint]);
            for (moment, value) in link.first_moment.iter_mut().zip(regrouped.first_moment) {
                moment.set_lane(lane, value);
            }
            for (entry, value) in link.inertia.iter_mut().zip(regrouped.inertia) {
                entry.set_lane(lane, value);
            }
        }
        if robot.friction.is_some() || self.friction.is_some() {
            let sigmoids = self.friction.get_or_insert_with(Sigmoids::none);
            sigmoids.set_lane(structure.joints(), lane, robot.friction.as_ref());
        }
    }
}

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

        let row = &robot.kinematics.joints[joint];
        let axis = Vector3::from(row.axis());
        let moment = axis * along;
        let origin = Vector3::from(row.origin());
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
