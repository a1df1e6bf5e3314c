use spec::{Gravity, RobotModel, RobotSpec};

use crate::panda::Bodies;
use crate::{Joints, RigidBody};

/// The physical parameters of one arm. Its kinematics are always the Panda's.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Each in its link's frame (modified DH frame `i`), hand and fingers welded to the last.
    pub links: Joints<RigidBody>,
    /// Viscous friction of each joint, N·m·s/rad.
    pub damping: Joints<f64>,
    /// Reflected rotor inertia of each joint, kg·m².
    pub armature: Joints<f64>,
    /// Downward acceleration along the base's z, m/s²; 0 when gravity is off.
    pub gravity: f64,
}

/// m/s². Standard gravity as simulators round it.
const GRAVITY: f64 = 9.81;

impl Robot {
    /// The nominal Panda with damping, armature and gravity of the default spec.
    pub fn panda() -> Self {
        Self::nominal(&RobotSpec::default())
    }

    /// The arm that `spec` randomizes around.
    pub fn nominal(spec: &RobotSpec) -> Self {
        Self::from_bodies(spec, &Bodies::of(spec.model), spec.damping_nm_s_rad)
    }

    pub(crate) fn from_bodies(spec: &RobotSpec, bodies: &Bodies, damping: Joints<f64>) -> Self {
        Self {
            links: bodies.welded(),
            damping,
            armature: spec.armature_kg_m2,
            gravity: match spec.gravity {
                Gravity::Off => 0.0,
                Gravity::On | Gravity::Compensated => GRAVITY,
            },
        }
    }
}

impl Bodies {
    pub(crate) fn of(model: RobotModel) -> Self {
        match model {
            RobotModel::Panda => Self::nominal(),
        }
    }
}
