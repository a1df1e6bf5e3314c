//! The description of an arm: base, joints, links, hand, and their randomization.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::initial_state::InitialState;
use crate::Range;
use crate::omitted::is_zero;

/// The largest number of joints of a robot.
pub const MAX_JOINTS: usize = 8;

/// An arm on a fixed base: a chain of 1 to 8 revolute joints. Each joint turns one link.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RobotDescription {
    /// A description in one line.
    pub name: String,
    /// The sources of the numbers, by block.
    #[serde(default)]
    pub sources: BTreeMap<String, String>,
    /// How the arm is mounted. The default is upright.
    #[serde(default, skip_serializing_if = "BaseDescription::is_upright")]
    pub base: BaseDescription,
    /// Joints, from the base outwards.
    #[schema(min_items = 1, max_items = 8)]
    pub joints: Vec<JointDescription>,
    /// The bodies at the last link, and the frame that poses are recorded of.
    #[serde(default)]
    pub hand: HandDescription,
    /// Default deviation of robots from these numbers.
    #[serde(default)]
    pub randomization: Randomization,
    /// Default initial state of motions.
    pub initial_state: InitialState,
}

impl RobotDescription {
    /// One value per joint.
    pub fn per_joint<'a, T>(&'a self, value: impl Fn(&'a JointDescription) -> T) -> Vec<T> {
        self.joints.iter().map(value).collect()
    }
}

/// The pose of the frame before the first joint in the world, whose z axis points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BaseDescription {
    /// Origin, m.
    #[schema(min_items = 3, max_items = 3)]
    pub position_m: [f64; 3],
    /// Turns about the world's x, y and z, one after the other, degrees: URDF's roll, pitch and yaw.
    /// An arm that hangs from the ceiling has `[180, 0, 0]`. Multiples of 45 are exact.
    #[schema(min_items = 3, max_items = 3)]
    pub rpy_deg: [f64; 3],
}

impl BaseDescription {
    /// Whether the frame before the first joint is the world.
    pub fn is_upright(&self) -> bool {
        *self == Self::default()
    }
}

/// A joint, with its row of the modified Denavit-Hartenberg table (Craig's) and the link that it
/// turns.
///
/// The joint's frame is the frame before, shifted by `a_m` along x and by `shift_m`, turned by
/// `alpha_deg` about x, shifted by `d_m` along z, and turned by the position plus `offset_deg` about z.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JointDescription {
    /// The joint's name, as its manufacturer calls it.
    pub name: String,
    /// Length along x of the frame before, m.
    pub a_m: f64,
    /// Angle about x of the frame before, degrees. Multiples of 45 are exact.
    pub alpha_deg: f64,
    /// Length along the joint's own axis, m.
    pub d_m: f64,
    /// Angle of the joint's frame at position 0, degrees. Multiples of 45 are exact.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset_deg: f64,
    /// A further shift, in the axes of the frame before, m. Proper tables have none. It serves
    /// axes that are nearly parallel, for which `a_m` and `d_m` would be huge.
    #[serde(default, skip_serializing_if = "is_no_shift")]
    #[schema(min_items = 3, max_items = 3)]
    pub shift_m: [f64; 3],
    /// Limits of the position, rad.
    pub position_rad: Range,
    /// Limit of the speed, rad/s.
    pub velocity_rad_s: f64,
    /// Rated torque, N·m.
    pub torque_nm: f64,
    /// Nominal viscous damping, N·m·s/rad.
    pub damping_nm_s_rad: f64,
    /// Nominal reflected rotor inertia, kg·m².
    #[serde(default)]
    pub armature_kg_m2: f64,
    /// Friction in addition to the damping, for specs that ask for it; `null` if it is not known.
    #[serde(default)]
    pub friction: Option<JointFriction>,
    /// Default κ of this joint in a multisine.
    #[serde(default = "one")]
    pub multisine_divisor: f64,
    /// The smallest inertia of the nominal arm's joint over all configurations within the limits,
    /// if all other joints move freely, without armature, kg·m². It decides which explicit steps
    /// are stable. `null` if it is not known.
    #[serde(default)]
    pub least_inertia_kg_m2: Option<f64>,
    /// The link, in the joint's frame, which moves with it.
    pub link: BodyDescription,
}

const fn one() -> f64 {
    1.0
}

impl JointDescription {
    /// Whether the joint is off the place that its row of the table gives.
    pub fn is_shifted(&self) -> bool {
        !is_no_shift(&self.shift_m)
    }
}

fn is_no_shift(shift_m: &[f64; 3]) -> bool {
    *shift_m == [0.0; 3]
}

/// Nominal values of the `friction` of a spec.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JointFriction {
    /// φ1, N·m.
    pub phi1_nm: f64,
    /// φ2, s/rad.
    pub phi2_s_rad: f64,
    /// φ3, rad/s.
    pub phi3_rad_s: f64,
}

/// A rigid body in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyDescription {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass, m.
    #[schema(min_items = 3, max_items = 3)]
    pub center_m: [f64; 3],
    /// xx, xy, xz, yy, yz, zz about the centre of mass, kg·m².
    #[schema(min_items = 6, max_items = 6)]
    pub inertia_kg_m2: [f64; 6],
    /// Whether to use the nearest inertia that a body can have. Otherwise an impossible inertia is
    /// refused.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub nearest_physical: bool,
}

/// The hand's frame, and the bodies fixed to the last link there.
///
/// The hand's frame follows the last link's as one joint's frame follows another's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HandDescription {
    /// A name for `bodies`, used in the descriptions of columns.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub contents: String,
    /// Length along x of the last link's frame, m.
    #[serde(skip_serializing_if = "is_zero")]
    pub a_m: f64,
    /// Angle about x of the last link's frame, degrees. Multiples of 45 are exact.
    #[serde(skip_serializing_if = "is_zero")]
    pub alpha_deg: f64,
    /// A further shift, in the axes of the last link's frame, m.
    #[serde(skip_serializing_if = "is_no_shift")]
    #[schema(min_items = 3, max_items = 3)]
    pub shift_m: [f64; 3],
    /// Distance to the hand's frame along its z, m.
    pub flange_m: f64,
    /// Rotation of the hand's frame about its z, degrees. Multiples of 45 are exact.
    pub yaw_deg: f64,
    /// The bodies. They may be none.
    pub bodies: Vec<AttachedBody>,
}

impl HandDescription {
    /// Whether the hand is off the place that its row of the table gives.
    pub fn is_shifted(&self) -> bool {
        !is_no_shift(&self.shift_m)
    }
}

/// A body that is part of the hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AttachedBody {
    /// The body's name.
    pub name: String,
    /// Origin of the body's frame in the hand's frame, m. Their axes are parallel.
    #[serde(default)]
    #[schema(min_items = 3, max_items = 3)]
    pub position_m: [f64; 3],
    /// The body, in a frame whose origin is at `position_m`.
    pub body: BodyDescription,
}

/// Half-widths of the randomization, like those in a spec's `robot`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Randomization {
    /// Half-width of masses.
    pub mass_fraction: f64,
    /// Half-width of the coordinates of centres of mass.
    pub com_fraction: f64,
    /// Half-width of inertias.
    pub inertia_fraction: f64,
    /// How inertias are drawn.
    pub inertia_scheme: InertiaScheme,
    /// Half-width of dampings.
    pub damping_fraction: f64,
    /// Half-width of armatures.
    pub armature_fraction: f64,
    /// Half-width of the lengths of the kinematics.
    pub geometry_fraction: f64,
}

impl Default for Randomization {
    fn default() -> Self {
        Self {
            mass_fraction: 0.1,
            com_fraction: 0.1,
            inertia_fraction: 0.1,
            inertia_scheme: InertiaScheme::PseudoInertia,
            damping_fraction: 0.1,
            armature_fraction: 0.0,
            geometry_fraction: 0.0,
        }
    }
}

/// How inertia tensors are randomized.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum InertiaScheme {
    /// Congruence of the second-moment matrix, which is always physical.
    PseudoInertia,
    /// The paper's code: every entry independently, then projected onto physical tensors.
    PerEntry,
}
