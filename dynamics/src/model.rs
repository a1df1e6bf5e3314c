use crate::friction::Sigmoids;
use crate::lanes::Lanes;
use crate::{Joints, Robot};

/// What does not change while robots move: their parameters, one robot per lane.
pub(crate) struct Model<L> {
    pub(crate) links: Joints<Link<L>>,
    /// Of each joint, in the frame of the link before it.
    pub(crate) origins: Joints<[L; 3]>,
    pub(crate) damping: Joints<L>,
    pub(crate) armature: Joints<L>,
    /// `None` when no robot has any.
    pub(crate) friction: Option<Sigmoids<L>>,
    /// Of the base, upwards, which is what a still robot under gravity feels.
    pub(crate) base_acceleration: L,
}

/// Inertial parameters of a link with respect to the origin of its frame, in which spatial
/// inertias add and the parallel-axis theorem is used up.
#[derive(Clone, Copy)]
pub(crate) struct Link<L> {
    pub(crate) mass: L,
    /// Mass times centre of mass.
    pub(crate) first_moment: [L; 3],
    /// Entries xx, xy, xz, yy, yz, zz.
    pub(crate) inertia: [L; 6],
}

impl<L: Lanes> Model<L> {
    /// The same robot in every lane.
    #[inline(always)]
    pub(crate) fn splat(robot: &Robot) -> Self {
        let zero = L::splat(0.0);
        let link = Link { mass: zero, first_moment: [zero; 3], inertia: [zero; 6] };
        let mut model = Self {
            links: [link; spec::JOINTS],
            origins: [[zero; 3]; spec::JOINTS],
            damping: [zero; spec::JOINTS],
            armature: [zero; spec::JOINTS],
            friction: None,
            base_acceleration: zero,
        };
        for lane in 0..L::LANES {
            model.set_lane(lane, robot);
        }
        model
    }

    #[inline(always)]
    pub(crate) fn set_lane(&mut self, lane: usize, robot: &Robot) {
        self.base_acceleration.set_lane(lane, robot.gravity);
        let origins = robot.kinematics.joint_origins();
        for joint in 0..spec::JOINTS {
            self.damping[joint].set_lane(lane, robot.damping[joint]);
            self.armature[joint].set_lane(lane, robot.armature[joint]);
            for (coordinate, value) in self.origins[joint].iter_mut().zip(origins[joint]) {
                coordinate.set_lane(lane, value);
            }
            let (body, link) = (&robot.links[joint], &mut self.links[joint]);
            link.mass.set_lane(lane, body.mass);
            for (moment, com) in link.first_moment.iter_mut().zip(body.com) {
                moment.set_lane(lane, body.mass * com);
            }
            for (entry, inertia) in link.inertia.iter_mut().zip(body.inertia_about_origin()) {
                entry.set_lane(lane, inertia);
            }
        }
        if robot.friction.is_some() || self.friction.is_some() {
            let sigmoids = self.friction.get_or_insert_with(Sigmoids::none);
            sigmoids.set_lane(lane, robot.friction.as_ref());
        }
    }
}
