use simd::Lanes;

use crate::Robot;
use crate::friction::Sigmoids;
use crate::regrouping::{Link, regrouped};
use crate::spatial::Turn;
use crate::structure::Structure;

/// The constants of moving robots: their parameters, one robot per lane.
pub(crate) struct Model<L, const N: usize> {
    pub(crate) links: [Link<L>; N],
    /// Origin of each joint, in the frame of the link before it.
    pub(crate) origins: [[L; 3]; N],
    /// Twists about x of the frame before. Compiled structures do not read them.
    pub(crate) twists: [Turn<L>; N],
    pub(crate) damping: [L; N],
    pub(crate) armature: [L; N],
    /// `None` when no robot has any.
    pub(crate) friction: Option<Sigmoids<L, N>>,
    /// Acceleration of the base, upwards. A robot at rest under gravity feels the same.
    pub(crate) base_acceleration: L,
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
            damping: [zero; N],
            armature: [zero; N],
            friction: None,
            base_acceleration: zero,
        };
        for lane in 0..L::LANES {
            model.set_lane(structure, lane, robot);
        }
        model
    }

    #[inline(always)]
    pub(crate) fn set_lane(&mut self, structure: impl Structure<N>, lane: usize, robot: &Robot) {
        self.base_acceleration.set_lane(lane, robot.gravity);
        let regrouped = regrouped(robot);
        for joint in 0..structure.joints() {
            let twist = robot.kinematics.twists[joint];
            self.twists[joint].sin.set_lane(lane, twist.sin);
            self.twists[joint].cos.set_lane(lane, twist.cos);
            self.damping[joint].set_lane(lane, robot.damping[joint]);
            self.armature[joint].set_lane(lane, robot.armature[joint]);
            for (coordinate, value) in
                self.origins[joint].iter_mut().zip(robot.kinematics.joint_origin(joint))
            {
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
