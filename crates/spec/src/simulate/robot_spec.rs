//! The arm of a simulation: its parameters, friction, payload and gravity, and how robots differ.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::doubt::Doubt;
use crate::{InertiaScheme, JointDescription, Range, RobotDescription, RobotModel};

/// The arm, and how far each robot's parameters deviate from the nominal ones.
///
/// Fractions are half-widths: 0.1 draws uniformly from 90 % to 110 % of the nominal value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RobotSpec {
    /// The robot. Fields that are left out below have the values of its description.
    pub model: RobotModel,
    /// Fraction for each body's mass.
    pub mass_fraction: f64,
    /// Fraction for each coordinate of each body's centre of mass.
    pub com_fraction: f64,
    /// Fraction for each body's inertia, drawn according to `inertia_scheme`.
    pub inertia_fraction: f64,
    /// How inertias are drawn.
    pub inertia_scheme: InertiaScheme,
    /// Fraction for each joint's damping.
    pub damping_fraction: f64,
    /// Nominal viscous damping of each joint, N·m·s/rad.
    pub damping_nm_s_rad: Vec<f64>,
    /// Fraction for each joint's armature.
    pub armature_fraction: f64,
    /// Nominal reflected rotor inertia of each joint, kg·m².
    pub armature_kg_m2: Vec<f64>,
    /// Fraction for each length of the kinematics: every a and d of the modified DH table that is
    /// not zero, and the flange's distance. Twists do not change.
    pub geometry_fraction: f64,
    /// Friction in addition to the viscous damping; `null` for none, as in the paper's simulator.
    pub friction: Option<Friction>,
    /// The load in the hand; `null` for none.
    pub payload: Option<Payload>,
    /// Whether gravity acts on the arm.
    pub gravity: Gravity,
}

impl Default for RobotSpec {
    fn default() -> Self {
        Self::of(RobotModel::panda())
    }
}

impl RobotSpec {
    /// `model` with its own nominal values and randomization, without gravity.
    pub fn of(model: RobotModel) -> Self {
        let description = model.description();
        let law = description.randomization;
        Self {
            mass_fraction: law.mass_fraction,
            com_fraction: law.com_fraction,
            inertia_fraction: law.inertia_fraction,
            inertia_scheme: law.inertia_scheme,
            damping_fraction: law.damping_fraction,
            damping_nm_s_rad: description.per_joint(|joint| joint.damping_nm_s_rad),
            armature_fraction: law.armature_fraction,
            armature_kg_m2: description.per_joint(|joint| joint.armature_kg_m2),
            geometry_fraction: law.geometry_fraction,
            friction: None,
            payload: None,
            gravity: Gravity::Off,
            model,
        }
    }

    /// The nominal arm.
    pub fn description(&self) -> &RobotDescription {
        self.model.description()
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.description().joints.len()
    }

    /// The warning about friction that a described arm has and this spec leaves out. Built-in arms
    /// get none, because their presets leave it out on purpose.
    pub fn friction_doubt(&self) -> Option<Doubt> {
        let (None, RobotModel::Described(description)) = (&self.friction, &self.model) else {
            return None;
        };
        let rubs = |joint: &&JointDescription| {
            joint.friction.is_some_and(|friction| friction.phi1_nm > 0.0)
        };
        let rubbing = description.joints.iter().filter(rubs);
        let names: Vec<&str> = rubbing.map(|joint| joint.name.as_str()).collect();
        if names.is_empty() {
            return None;
        }
        let remedy = match Friction::nominal(description) {
            Some(_) => "say \"friction\": {} to simulate it",
            None => {
                "give \"friction\" phi1_nm, phi2_s_rad and phi3_rad_s of every joint to simulate it"
            }
        };
        let joints = if names.len() == 1 { "joint" } else { "joints" };
        let reason = format!(
            "robot.model has friction of {joints} {}, which this spec leaves out; {remedy}",
            names.join(", ")
        );
        Some(Doubt { field: "robot.friction".to_owned(), value: "null".to_owned(), reason })
    }
}

/// Whether gravity acts on the arm, and whether its controller compensates it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Gravity {
    /// No gravity, as in the paper's dataset recipe.
    Off,
    /// 9.81 m/s² along -z of the world, not compensated.
    On,
    /// Like `on`, but the arm's own controller adds the robot's exact gravity torque g(q) to the
    /// excitation at every sample. Both are held until the next sample, and `u` is their sum.
    Compensated,
}

/// τ_f(q̇) = φ1 / (1 + exp(-φ2 (q̇ + φ3))) - φ1 / (1 + exp(-φ2 φ3)), with one triple per joint.
///
/// Source: Gaz et al. 2019, equation 19. Values that are left out come from the robot's
/// description.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Friction {
    /// φ1, N·m.
    pub phi1_nm: Vec<f64>,
    /// φ2, s/rad.
    pub phi2_s_rad: Vec<f64>,
    /// φ3, rad/s.
    pub phi3_rad_s: Vec<f64>,
    /// Half-width of each joint's φ1, as a fraction of the nominal one.
    pub phi1_fraction: f64,
}

impl Default for Friction {
    fn default() -> Self {
        let friction = Self::nominal(RobotModel::panda().description());
        friction.expect("the description of the Panda has friction")
    }
}

impl Friction {
    /// The friction in `robot`'s description; `None` unless every joint has one.
    pub(super) fn nominal(robot: &RobotDescription) -> Option<Self> {
        let joints: Option<Vec<_>> = robot.joints.iter().map(|joint| joint.friction).collect();
        let joints = joints?;
        Some(Self {
            phi1_nm: joints.iter().map(|friction| friction.phi1_nm).collect(),
            phi2_s_rad: joints.iter().map(|friction| friction.phi2_s_rad).collect(),
            phi3_rad_s: joints.iter().map(|friction| friction.phi3_rad_s).collect(),
            phi1_fraction: 0.1,
        })
    }
}

/// A solid sphere of uniform density, fixed to the hand. Every number is drawn for each robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Payload {
    /// Mass, kg.
    pub mass_kg: Range,
    /// Centre along x, y and z of the hand's frame, m. Its z axis points from the flange to the
    /// fingers.
    #[serde(default = "between_the_fingertips")]
    #[schema(min_items = 3, max_items = 3)]
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
