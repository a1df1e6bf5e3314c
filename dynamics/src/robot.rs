use spec::{Gravity, RobotModel, RobotSpec};

use crate::panda::{Bodies, KINEMATICS};
use crate::{Friction, Joints, Kinematics, RigidBody};

/// The physical parameters of one arm of the Panda's build.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Each in its link's frame (modified DH frame `i`); hand, fingers and payload are welded to the last.
    pub links: Joints<RigidBody>,
    /// Viscous friction of each joint, N·m·s/rad.
    pub damping: Joints<f64>,
    /// Reflected rotor inertia of each joint, kg·m².
    pub armature: Joints<f64>,
    pub kinematics: Kinematics,
    /// Friction besides the damping.
    pub friction: Option<Friction>,
    /// What the hand carries; `links` contains it already.
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

/// m/s². Standard gravity as simulators round it.
const GRAVITY: f64 = 9.81;

impl Robot {
    /// The nominal Panda with damping, armature and gravity of the default spec.
    pub fn panda() -> Self {
        Self::nominal(&RobotSpec::default())
    }

    /// The arm that `spec` randomizes around; the hand holds the middle of the payload's ranges.
    pub fn nominal(spec: &RobotSpec) -> Self {
        let parts = Parts {
            bodies: Bodies::of(spec.model),
            damping: spec.damping_nm_s_rad,
            armature: spec.armature_kg_m2,
            kinematics: KINEMATICS,
            friction: spec.friction.as_ref().map(Friction::nominal),
            payload: spec.payload.as_ref().map(Payload::nominal),
        };
        parts.assembled(spec.gravity)
    }
}

/// What a robot is made of, before anything is welded.
pub(crate) struct Parts {
    pub(crate) bodies: Bodies,
    pub(crate) damping: Joints<f64>,
    pub(crate) armature: Joints<f64>,
    pub(crate) kinematics: Kinematics,
    pub(crate) friction: Option<Friction>,
    pub(crate) payload: Option<Payload>,
}

impl Parts {
    pub(crate) fn assembled(self, gravity: Gravity) -> Robot {
        let held = self.payload.map(|payload| payload.body());
        Robot {
            links: self.bodies.welded(self.kinematics.flange_m, held.as_ref()),
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

impl Bodies {
    pub(crate) fn of(model: RobotModel) -> Self {
        match model {
            RobotModel::Panda => Self::nominal(),
        }
    }
}
