use simd::Lanes;

use crate::friction::Sigmoids;
use crate::regrouping::regrouped;
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

/// Inertial parameters of a link with respect to the origin of its frame, in which spatial inertias add
/// and the parallel-axis theorem is used up, and regrouped, so that the others are zero.
#[derive(Clone, Copy)]
pub(crate) struct Link<L> {
    /// Mass times x and y of the centre of mass.
    pub(crate) first_moment: [L; 2],
    /// Entries xx, xy, xz, yz, zz.
    pub(crate) inertia: [L; 5],
}

impl<L: Lanes> Model<L> {
    /// The same robot in every lane.
    #[inline(always)]
    pub(crate) fn splat(robot: &Robot) -> Self {
        let zero = L::splat(0.0);
        let link = Link { first_moment: [zero; 2], inertia: [zero; 5] };
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
        let regrouped = regrouped(robot);
        for joint in 0..spec::JOINTS {
            self.damping[joint].set_lane(lane, robot.damping[joint]);
            self.armature[joint].set_lane(lane, robot.armature[joint]);
            for (coordinate, value) in self.origins[joint].iter_mut().zip(origins[joint]) {
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
            sigmoids.set_lane(lane, robot.friction.as_ref());
        }
    }
}
