use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::JOINTS;

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
    /// Reflected rotor inertia, kg·m²; not randomized.
    pub armature_kg_m2: [f64; JOINTS],
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
            armature_kg_m2: [0.01; JOINTS],
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
}
