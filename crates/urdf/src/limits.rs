//! Limits and friction of a joint, with defaults for those that are missing.

use std::f64::consts::{PI, TAU};

use spec::{JointFriction, Range};

use crate::document::{Joint, JointDynamics, Kind};
use crate::part::Doubts;
use crate::{Part, UrdfError};

/// Limits of positions without limits, rad: two turns, one to each side.
const POSITION_RAD: Range = Range::new(-TAU, TAU);
/// Speed of joints without a limit, rad/s: half a turn in a second.
const VELOCITY_RAD_S: f64 = PI;
/// Torque of joints without a limit, N·m.
const TORQUE_NM: f64 = 100.0;

/// Bounds of descriptions.
const MAX_POSITION_RAD: f64 = 100.0;
const MAX_VELOCITY_RAD_S: f64 = 1000.0;
const MAX_TORQUE_NM: f64 = 1e5;
const LEAST_LIMIT: f64 = 1e-3;
const MAX_DAMPING_NM_S_RAD: f64 = 1000.0;
const MAX_FRICTION_NM: f64 = 50.0;
const MAX_ARMATURE_KG_M2: f64 = 10.0;

/// φ2 of a friction whose `<dynamics>` has none, s/rad. Coulomb friction f is f tanh(20 q̇) then.
pub(crate) const PHI2_S_RAD: f64 = 40.0;
const MAX_PHI2_S_RAD: f64 = 1000.0;

/// The numbers of a joint beside its place and its body.
pub(crate) struct Limits {
    pub(crate) position_rad: Range,
    pub(crate) velocity_rad_s: f64,
    pub(crate) torque_nm: f64,
    pub(crate) damping_nm_s_rad: f64,
    /// Coulomb friction, N·m.
    pub(crate) friction_nm: f64,
    /// The friction's φ2 as the URDF says it, s/rad.
    pub(crate) phi2_s_rad: Option<f64>,
    pub(crate) armature_kg_m2: f64,
}

impl Limits {
    pub(crate) fn of(joint: &Joint, doubts: &mut Doubts) -> Result<Self, UrdfError> {
        let limit = joint.limit.unwrap_or_default();
        let rate = |limit, most, default, name, unit, doubts: &mut _| {
            Rate { limit, most, default, name, unit }.of(joint, doubts)
        };
        let velocity_rad_s =
            rate(limit.velocity, MAX_VELOCITY_RAD_S, VELOCITY_RAD_S, "velocity", "rad/s", doubts)?;
        let torque_nm = rate(limit.effort, MAX_TORQUE_NM, TORQUE_NM, "effort", "N·m", doubts)?;
        let position_rad = positions(joint, doubts)?;
        let JointDynamics { damping, friction, armature, phi2 } =
            joint.friction.unwrap_or_default();
        within(joint, "dynamics damping", damping, MAX_DAMPING_NM_S_RAD, "N·m·s/rad")?;
        within(joint, "dynamics friction", friction, MAX_FRICTION_NM, "N·m")?;
        within(joint, "dynamics armature", armature, MAX_ARMATURE_KG_M2, "kg·m²")?;
        if let Some(phi2) = phi2 {
            within(joint, "dynamics phi2_s_rad", phi2, MAX_PHI2_S_RAD, "s/rad")?;
        }
        Ok(Self {
            position_rad,
            velocity_rad_s,
            torque_nm,
            damping_nm_s_rad: damping,
            friction_nm: friction,
            phi2_s_rad: phi2,
            armature_kg_m2: armature,
        })
    }
}

/// Whether a friction is the same in both directions, as the frictions that are [`described`].
pub(crate) fn is_coulomb(friction: &JointFriction) -> bool {
    friction.phi1_nm == 0.0 || friction.phi3_rad_s == 0.0
}

/// Coulomb friction as a description has it: φ1 / (1 + exp(-φ2 q̇)) - φ1 / 2 = φ1 / 2 tanh(φ2 q̇ / 2).
pub(crate) fn described(friction_nm: f64, phi2_s_rad: Option<f64>) -> JointFriction {
    let phi2_s_rad = phi2_s_rad.unwrap_or(PHI2_S_RAD);
    JointFriction { phi1_nm: 2.0 * friction_nm, phi2_s_rad, phi3_rad_s: 0.0 }
}

fn within(joint: &Joint, field: &str, value: f64, most: f64, unit: &str) -> Result<(), UrdfError> {
    if (0.0..=most).contains(&value) {
        return Ok(());
    }
    let allowed = format!("0 to {most} {unit}");
    Err(refused(joint, field, value.to_string(), &allowed))
}

fn refused(joint: &Joint, field: &str, value: String, allowed: &str) -> UrdfError {
    UrdfError::Value {
        part: Part::Joint(joint.name.clone()),
        field: field.to_owned(),
        value,
        allowed: allowed.to_owned(),
    }
}

/// A limit of speed or torque.
struct Rate {
    limit: Option<f64>,
    most: f64,
    default: f64,
    name: &'static str,
    unit: &'static str,
}

impl Rate {
    fn of(&self, joint: &Joint, doubts: &mut Doubts) -> Result<f64, UrdfError> {
        let Self { limit, most, default, name, unit } = *self;
        match limit {
            Some(limit) if limit > most => {
                doubts.joint(
                    &joint.name,
                    format!("its {name} limit of {limit} {unit} is no limit: {most} is assumed"),
                );
                Ok(most)
            }
            Some(limit) if limit >= LEAST_LIMIT => Ok(limit),
            Some(0.0) | None => {
                let found = if limit.is_some() { "a zero" } else { "no" };
                doubts.joint(
                    &joint.name,
                    format!("it has {found} {name} limit: {default:.4} {unit} is assumed"),
                );
                Ok(default)
            }
            Some(limit) => {
                let allowed = format!("{LEAST_LIMIT} to {most} {unit}, or 0 if it is not known");
                Err(refused(joint, &format!("limit {name}"), limit.to_string(), &allowed))
            }
        }
    }
}

fn positions(joint: &Joint, doubts: &mut Doubts) -> Result<Range, UrdfError> {
    let limit = joint.limit.unwrap_or_default();
    if joint.kind == Kind::Continuous {
        doubts.joint(&joint.name, "it turns without end: positions within ±2π are assumed");
        return Ok(POSITION_RAD);
    }
    // URDF's default of a limit that is not written is 0.
    let written = [limit.lower, limit.upper];
    if written == [None, None] {
        doubts.joint(&joint.name, "it has no limits of its position: ±2π are assumed");
        return Ok(POSITION_RAD);
    }
    let [lower, upper] = written.map(|limit| limit.unwrap_or(0.0));
    if [lower, upper] == [f64::NEG_INFINITY, f64::INFINITY] {
        doubts.joint(&joint.name, "its position has infinite limits: ±2π are assumed");
        return Ok(POSITION_RAD);
    }
    if lower.abs() > MAX_POSITION_RAD || upper.abs() > MAX_POSITION_RAD {
        let allowed = format!("within ±{MAX_POSITION_RAD} rad");
        return Err(refused(joint, "limit lower, upper", format!("{lower}, {upper}"), &allowed));
    }
    if upper - lower < LEAST_LIMIT {
        let allowed = format!(
            "an upper limit at least {LEAST_LIMIT} rad above the lower; without both, ±2π are assumed, \
             and `--lock {}=VALUE` freezes the joint",
            crate::part::shown(&joint.name)
        );
        return Err(refused(joint, "limit lower, upper", format!("{lower}, {upper}"), &allowed));
    }
    Ok(Range::new(lower, upper))
}
