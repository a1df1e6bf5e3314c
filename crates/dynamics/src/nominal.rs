//! The nominal arm of a description: its bodies before any are welded, and their places.

use nalgebra::{Matrix3, Rotation3, Vector3};
use spec::{BodyDescription, RobotDescription};

use crate::angle::Angle;
use crate::{Joints, Kinematics, RigidBody};

/// The nominal robot, around which those of a description are drawn.
#[derive(Clone, Debug)]
pub(crate) struct Nominal {
    /// The links, each in its own frame.
    pub(crate) links: Joints<RigidBody>,
    /// The parts of the hand. Each has a frame parallel to the hand's, with this origin.
    pub(crate) attached: Vec<(RigidBody, [f64; 3])>,
    pub(crate) kinematics: Kinematics,
}

impl Nominal {
    pub(crate) fn of(description: &RobotDescription) -> Self {
        let joints = &description.joints;
        let hand = &description.hand;
        let attached = |part: &spec::AttachedBody| (body(&part.body), part.position_m);
        Self {
            links: joints.iter().map(|joint| body(&joint.link)).collect(),
            attached: hand.bodies.iter().map(attached).collect(),
            kinematics: Kinematics {
                a_m: joints.iter().map(|joint| joint.a_m).collect(),
                d_m: joints.iter().map(|joint| joint.d_m).collect(),
                twists: joints.iter().map(|joint| Angle::degrees(joint.alpha_deg)).collect(),
                flange_m: hand.flange_m,
                hand_yaw: Angle::degrees(hand.yaw_deg),
            },
        }
    }
}

fn body(description: &BodyDescription) -> RigidBody {
    let BodyDescription { mass_kg, center_m, inertia_kg_m2, nearest_physical } = *description;
    let body = RigidBody::new(mass_kg, center_m, inertia_kg_m2);
    if nearest_physical { body.projected() } else { body }
}

/// The bodies welded together so far, in the hand's frame.
#[derive(Clone, Copy, Default)]
pub(crate) struct Hand(Option<RigidBody>);

impl Hand {
    #[must_use]
    pub(crate) fn with(self, body: &RigidBody, position_m: [f64; 3]) -> Self {
        let moved = match position_m {
            [0.0, 0.0, 0.0] => *body,
            _ => body.seen_from(&Rotation3::identity(), &Vector3::from(position_m)),
        };
        Self(Some(self.0.map_or(moved, |hand| hand.welded_to(&moved))))
    }

    /// The last link of an arm with this hand.
    pub(crate) fn welded_to(self, last: &RigidBody, kinematics: &Kinematics) -> RigidBody {
        let Some(hand) = self.0 else { return *last };
        let Angle { sin, cos, .. } = kinematics.hand_yaw;
        let yaw = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        let flange = Vector3::new(0.0, 0.0, kinematics.flange_m);
        last.welded_to(&hand.seen_from(&Rotation3::from_matrix_unchecked(yaw), &flange))
    }
}

#[cfg(test)]
mod tests {
    use spec::RobotModel;

    use super::*;

    fn panda() -> Nominal {
        Nominal::of(RobotModel::panda().description())
    }

    #[test]
    fn every_nominal_body_is_physical_the_published_hand_once_it_is_projected() {
        let panda = panda();
        let attached = panda.attached.iter().map(|(body, _)| body);
        for (index, body) in panda.links.iter().chain(attached).enumerate() {
            assert!(body.is_physical(), "body {index}");
        }
        let published = RobotModel::panda().description().hand.bodies[0].body;
        assert!(!body(&BodyDescription { nearest_physical: false, ..published }).is_physical());
    }

    #[test]
    fn the_projected_hand_turns_as_published_about_its_wide_axis() {
        let published = RobotModel::panda().description().hand.bodies[0].body.inertia_kg_m2;
        let (hand, _) = panda().attached[0];
        assert!((hand.inertia[0][0] - published[0]).abs() < 1e-6);
        assert!((hand.inertia[2][2] - published[5] - 0.00064).abs() < 1e-5);
    }

    #[test]
    fn welding_keeps_the_mass() {
        let panda = panda();
        let hand =
            panda.attached.iter().fold(Hand::default(), |hand, (body, at)| hand.with(body, *at));
        let welded = hand.welded_to(&panda.links[6], &panda.kinematics);
        let apart: f64 = panda.attached.iter().map(|(body, _)| body.mass).sum();
        assert!((welded.mass - panda.links[6].mass - apart).abs() < 1e-15);
    }
}
