//! The joints with which a training begins.

use spec::{JointDescription, RobotDescription};

use super::law::Limits;

/// Initial means and spreads of a joint over robots.
#[derive(Clone, Copy, Debug)]
pub(super) struct NominalJoint {
    /// Mean damping, N·m·s/rad.
    pub damping: f32,
    pub damping_spread: f32,
    /// Mean friction, in its unit.
    pub friction: f32,
    /// N·m. Training moves the mean by a share of it.
    pub friction_unit: f32,
    /// Spread of frictions and of offsets, N·m.
    pub friction_spread: f32,
    /// Slope of friction at rest, s/rad.
    pub slope: f32,
    /// Mean rotor inertia, kg m².
    pub rotor: f32,
    /// Limits of its motion.
    pub limits: Limits,
}

/// Values that a description leaves open, as shares of the rated torque: friction in N·m, damping in
/// N·m·s/rad, and rotor inertia in kg m².
const FRICTION_SHARE: f64 = 0.01;
const DAMPING_SHARE: f64 = 0.01;
const ROTOR_SHARE: f64 = 0.001;
/// The spread of dampings and frictions, as a share of their means.
const SPREAD_SHARE: f64 = 0.5;
/// Slope of friction at rest, s/rad.
const SLOPE: f64 = 4.0;
/// The largest speed of a prediction as a ratio to the joint's rated speed, which noise may exceed.
const SPEED_MARGIN: f64 = 1.25;

/// Joints of which nothing is known.
pub(super) fn unknown(joints: usize) -> Vec<NominalJoint> {
    let joint = NominalJoint {
        damping: 1.0,
        damping_spread: 1.0,
        friction: 0.0,
        friction_unit: 1.0,
        friction_spread: 0.1,
        slope: 4.0,
        rotor: 0.1,
        limits: Limits::UNKNOWN,
    };
    vec![joint; joints]
}

/// The joints of a description.
pub(super) fn of(robot: &RobotDescription) -> Vec<NominalJoint> {
    robot.per_joint(of_joint)
}

#[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
fn of_joint(joint: &JointDescription) -> NominalJoint {
    let known = |value: f64, share: f64| if value > 0.0 { value } else { share * joint.torque_nm };
    let damping = known(joint.damping_nm_s_rad, DAMPING_SHARE);
    // The description's sigmoid goes from -φ1 / 2 to φ1 / 2, with the slope φ2 / 2 of a tanh.
    let sigmoid = joint.friction.filter(|friction| friction.phi1_nm > 0.0);
    let friction = known(sigmoid.map_or(0.0, |friction| friction.phi1_nm / 2.0), FRICTION_SHARE);
    NominalJoint {
        damping: damping as f32,
        damping_spread: (SPREAD_SHARE * damping) as f32,
        friction: 1.0,
        friction_unit: friction as f32,
        friction_spread: (SPREAD_SHARE * friction) as f32,
        slope: sigmoid.map_or(SLOPE, |friction| (friction.phi2_s_rad / 2.0).max(0.1)) as f32,
        rotor: known(joint.armature_kg_m2, ROTOR_SHARE) as f32,
        limits: Limits {
            position: [joint.position_rad.min, joint.position_rad.max].map(|limit| limit as f32),
            speed: (SPEED_MARGIN * joint.velocity_rad_s) as f32,
        },
    }
}
