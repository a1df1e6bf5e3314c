//! Robots: the physical parameters of one arm. The nominal arm of a description has its bodies before
//! any are welded, and their places.

use nalgebra::{Rotation3, Vector3};
use spec::{BodyDescription, Gravity, JointDescription, RobotDescription, RobotSpec};

use crate::angle::Angle;
use crate::kinematics::{Base, Row};
use crate::{Friction, Joints, Kinematics, RigidBody};

/// The physical parameters of one arm.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// The links, each in its own frame (modified DH frame `i`). Hand and payload are welded to the
    /// last one.
    pub links: Joints<RigidBody>,
    /// Viscous friction of each joint, N·m·s/rad.
    pub damping: Joints<f64>,
    /// Reflected rotor inertia of each joint, kg·m².
    pub armature: Joints<f64>,
    /// The places of the base, the joints and the hand.
    pub kinematics: Kinematics,
    /// Friction besides the damping.
    pub friction: Option<Friction>,
    /// The payload in the hand. `links` already includes it.
    pub payload: Option<Payload>,
    /// Downward acceleration along the world's z, m/s²; 0 when gravity is off.
    pub gravity: f64,
}

/// A solid sphere of even density, fixed to the hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Payload {
    /// kg.
    pub mass_kg: f64,
    /// In the hand's frame, m.
    pub center_m: [f64; 3],
    /// m.
    pub radius_m: f64,
}

/// Standard gravity, m/s², with the rounding that simulators use.
const GRAVITY: f64 = 9.81;

impl Robot {
    /// The number of joints.
    pub fn joints(&self) -> usize {
        self.links.len()
    }

    /// The nominal Panda with damping, armature and gravity of the default spec.
    pub fn panda() -> Self {
        Self::nominal(&RobotSpec::default())
    }

    /// The nominal arm of `spec`. The hand holds a payload in the middle of its ranges.
    pub fn nominal(spec: &RobotSpec) -> Self {
        let nominal = Nominal::of(spec.description());
        Self::assembled(spec, &nominal, nominal.kinematics)
    }

    /// The nominal arm of `spec` with other lengths. The hand is at the flange of `kinematics`.
    pub fn with_kinematics(spec: &RobotSpec, kinematics: Kinematics) -> Self {
        Self::assembled(spec, &Nominal::of(spec.description()), kinematics)
    }

    /// The robot with `payload` welded to the hand.
    #[must_use]
    pub fn holding(mut self, payload: Payload) -> Self {
        if let Some(last) = self.links.last_mut() {
            *last =
                Hand::default().with(&payload.body(), [0.0; 3]).welded_to(last, &self.kinematics);
        }
        Self { payload: Some(payload), ..self }
    }

    fn assembled(spec: &RobotSpec, nominal: &Nominal, kinematics: Kinematics) -> Self {
        let Nominal { links, attached, .. } = nominal;
        let hand = attached.iter().fold(Hand::default(), |hand, (body, at)| hand.with(body, *at));
        let parts = Parts {
            links: *links,
            hand,
            damping: spec.damping_nm_s_rad.as_slice().into(),
            armature: spec.armature_kg_m2.as_slice().into(),
            kinematics,
            friction: spec.friction.as_ref().map(Friction::nominal),
            payload: spec.payload.as_ref().map(Payload::nominal),
        };
        parts.assembled(spec.gravity)
    }
}

/// The parts of a robot, before hand and payload are welded to the last link.
pub(crate) struct Parts {
    pub(crate) links: Joints<RigidBody>,
    pub(crate) hand: Hand,
    pub(crate) damping: Joints<f64>,
    pub(crate) armature: Joints<f64>,
    pub(crate) kinematics: Kinematics,
    pub(crate) friction: Option<Friction>,
    pub(crate) payload: Option<Payload>,
}

impl Parts {
    pub(crate) fn assembled(mut self, gravity: Gravity) -> Robot {
        if let Some(payload) = &self.payload {
            self.hand = self.hand.with(&payload.body(), [0.0; 3]);
        }
        if let Some(last) = self.links.last_mut() {
            *last = self.hand.welded_to(last, &self.kinematics);
        }
        Robot {
            links: self.links,
            damping: self.damping,
            armature: self.armature,
            kinematics: self.kinematics,
            friction: self.friction,
            payload: self.payload,
            gravity: match gravity {
                Gravity::Off => 0.0,
                Gravity::On | Gravity::Compensated => GRAVITY,
            },
        }
    }
}

impl Payload {
    fn nominal(spec: &spec::Payload) -> Self {
        Self {
            mass_kg: spec.mass_kg.at(0.5),
            center_m: spec.center_m.map(|range| range.at(0.5)),
            radius_m: spec.radius_m.at(0.5),
        }
    }

    /// In the hand's frame.
    fn body(&self) -> RigidBody {
        let moment = 0.4 * self.mass_kg * self.radius_m * self.radius_m;
        RigidBody::new(self.mass_kg, self.center_m, [moment, 0.0, 0.0, moment, 0.0, moment])
    }
}

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
                base: Base::new(description.base.position_m, description.base.rpy_deg),
                joints: joints.iter().map(row).collect(),
                hand: Row {
                    a_m: hand.a_m,
                    d_m: hand.flange_m,
                    twist: Angle::degrees(hand.alpha_deg),
                    offset: Angle::degrees(hand.yaw_deg),
                    shift_m: hand.shift_m,
                },
            },
        }
    }
}

fn row(joint: &JointDescription) -> Row {
    Row {
        a_m: joint.a_m,
        d_m: joint.d_m,
        twist: Angle::degrees(joint.alpha_deg),
        offset: Angle::degrees(joint.offset_deg),
        shift_m: joint.shift_m,
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
        let turn = kinematics.hand.turn(0.0);
        last.welded_to(&hand.seen_from(&turn, &Vector3::from(kinematics.hand.origin())))
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
