use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{JOINTS, Range};

/// The arm and how far each robot's parameters lie from the nominal ones.
///
/// Fractions are half-widths: 0.1 draws uniformly from 90 % to 110 % of the nominal value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RobotSpec {
    pub model: RobotModel,
    /// Of each body's mass.
    pub mass_fraction: f64,
    /// Of each coordinate of each body's centre of mass.
    pub com_fraction: f64,
    /// Of each body's inertia, as `inertia_scheme` says.
    pub inertia_fraction: f64,
    pub inertia_scheme: InertiaScheme,
    /// Of each joint's damping.
    pub damping_fraction: f64,
    /// Nominal viscous damping, N·m·s/rad.
    pub damping_nm_s_rad: [f64; JOINTS],
    /// Of each joint's armature.
    pub armature_fraction: f64,
    /// Nominal reflected rotor inertia, kg·m².
    pub armature_kg_m2: [f64; JOINTS],
    /// Of each length of the kinematics: every a and d of the modified DH table that is not zero,
    /// and the flange's distance. Twists stay as they are.
    pub geometry_fraction: f64,
    /// Friction besides the viscous damping; `null` for none, as in the paper's simulator.
    pub friction: Option<Friction>,
    /// What the hand carries; `null` for nothing.
    pub payload: Option<Payload>,
    pub gravity: Gravity,
}

impl Default for RobotSpec {
    fn default() -> Self {
        Self {
            model: RobotModel::Panda,
            mass_fraction: 0.1,
            com_fraction: 0.1,
            inertia_fraction: 0.1,
            inertia_scheme: InertiaScheme::PseudoInertia,
            damping_fraction: 0.1,
            damping_nm_s_rad: [10.0; JOINTS],
            armature_fraction: 0.0,
            armature_kg_m2: [0.01; JOINTS],
            geometry_fraction: 0.0,
            friction: None,
            payload: None,
            gravity: Gravity::Off,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RobotModel {
    /// Franka Emika Panda with hand and fingers, parameters of Gaz et al. 2019.
    Panda,
}

/// Position limits of the joints, rad. Source: franka_description, robots/fer/joint_limits.yaml.
pub const JOINT_LIMITS_RAD: [Range; JOINTS] = [
    Range::new(-2.8973, 2.8973),
    Range::new(-1.7628, 1.7628),
    Range::new(-2.8973, 2.8973),
    Range::new(-3.0718, -0.0698),
    Range::new(-2.8973, 2.8973),
    Range::new(-0.0175, 3.7525),
    Range::new(-2.8973, 2.8973),
];

/// How inertia tensors are randomized.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum InertiaScheme {
    /// Congruence of the second-moment matrix: always physical.
    PseudoInertia,
    /// The paper's code: every entry on its own, then projected onto physical tensors.
    PerEntry,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Gravity {
    /// As in the paper's dataset recipe.
    Off,
    /// 9.81 m/s² along -z of the base, not compensated.
    On,
    /// As `on`, and the arm's own controller adds the robot's exact gravity torque g(q) at every
    /// sample to the excitation. Both are held until the next sample, and `u` is their sum.
    Compensated,
}

/// τ_f(q̇) = φ1 / (1 + exp(-φ2 (q̇ + φ3))) - φ1 / (1 + exp(-φ2 φ3)), one triple per joint.
///
/// Source: Gaz et al. 2019, equation 19 and table IV; the defaults are their estimates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Friction {
    /// φ1, N·m.
    pub phi1_nm: [f64; JOINTS],
    /// φ2, s/rad.
    pub phi2_s_rad: [f64; JOINTS],
    /// φ3, rad/s.
    pub phi3_rad_s: [f64; JOINTS],
    /// Half-width of each joint's φ1, as a fraction of the nominal one.
    pub phi1_fraction: f64,
}

impl Default for Friction {
    fn default() -> Self {
        Self {
            phi1_nm: [0.54615, 0.87224, 0.64068, 1.2794, 0.83904, 0.30301, 0.56489],
            phi2_s_rad: [5.1181, 9.0657, 10.136, 5.5903, 8.3469, 17.133, 10.336],
            phi3_rad_s: [0.039533, 0.025882, -0.04607, 0.036194, 0.026226, -0.021047, 0.0035526],
            phi1_fraction: 0.1,
        }
    }
}

/// A solid sphere of even density, fixed to the hand; every number is drawn for each robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Payload {
    /// kg.
    pub mass_kg: Range,
    /// Centre along x, y and z of the hand's frame, whose z points from the flange to the fingers, m.
    #[serde(default = "between_the_fingertips")]
    pub center_m: [Range; 3],
    /// Radius, m.
    #[serde(default = "radius")]
    pub radius_m: Range,
}

/// 0.1034 m is the hand's tool centre point (source: franka_description, hand's `tcp_xyz`).
const fn between_the_fingertips() -> [Range; 3] {
    [Range::new(0.0, 0.0), Range::new(0.0, 0.0), Range::new(0.1034, 0.1034)]
}

const fn radius() -> Range {
    Range::new(0.04, 0.04)
}
