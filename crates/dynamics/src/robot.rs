use spec::{Gravity, RobotSpec};

use crate::nominal::{Hand, Nominal};
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
    pub kinematics: Kinematics,
    /// Friction besides the damping.
    pub friction: Option<Friction>,
    /// The payload in the hand. `links` already includes it.
    pub payload: Option<Payload>,
    /// Downward acceleration along the base's z, m/s²; 0 when gravity is off.
    pub gravity: f64,
}

/// A solid sphere of even density, fixed to the hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Payload {
    pub mass_kg: f64,
    /// In the hand's frame, m.
    pub center_m: [f64; 3],
    pub radius_m: f64,
}

/// Standard gravity, m/s², with the rounding that simulators use.
const GRAVITY: f64 = 9.81;

impl Robot {
    pub fn joints(&self) -> usize {
        self.links.len()
    }

    /// The nominal Panda with damping, armature and gravity of the default spec.
    pub fn panda() -> Self {
        Self::nominal(&RobotSpec::default())
    }

    /// The nominal arm of `spec`. The hand holds a payload in the middle of its ranges.
    pub fn nominal(spec: &RobotSpec) -> Self {
        let Nominal { links, attached, kinematics } = Nominal::of(spec.description());
        let hand = attached.iter().fold(Hand::default(), |hand, (body, at)| hand.with(body, *at));
        let parts = Parts {
            links,
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
