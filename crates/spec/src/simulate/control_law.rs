//! The laws of controllers, and their gains.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::Range;
use crate::check::{Check, Violations};

/// The law by which a controller turns errors into torques. r is the reference, q the measured
/// position, and v its velocity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ControlLaw {
    /// u = kp (r − q) + kd (ṙ − v) + ki ∫(r − q) dt, and gravity.
    JointPd(JointPd),
    /// u = M(q) (r̈ + kp (r − q) + kd (ṙ − v) + ki ∫(r − q) dt) + C(q, v) v, and gravity, with the
    /// nominal arm's M and C.
    ComputedTorque(ComputedTorque),
    /// u = Jᵀ Λ (ẍ_r + kp e + kd (ẋ_r − ẋ) − J̇ v − J p) + M p + C v, and gravity (Khatib 1987). x is
    /// the pose of the nominal arm's hand, e its error, Λ = (J M⁻¹ Jᵀ)⁻¹, and p = r̈ + kn (r − q) +
    /// dn (ṙ − v) keeps the posture of an arm with more joints than the task needs.
    OperationalSpace(OperationalSpace),
    /// u = Jᵀ (kp e + kd (ẋ_r − ẋ)) + N (kn (r − q) + dn (ṙ − v)), and gravity: springs and dampers
    /// at the hand. N = 1 − Jᵀ (J Jᵀ)⁻¹ J takes out what would move the hand.
    CartesianImpedance(CartesianImpedance),
}

/// Gains of a controller of single joints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct JointPd {
    /// Interval of ω / 2π. A joint with the nominal inertia I at `initial_state.center_rad` has kp
    /// = I ω².
    pub natural_frequency_hz: Range,
    /// Interval of ζ: kd = 2 ζ ω I.
    pub damping_ratio: Range,
    /// Interval of ki / kp, 1/s.
    pub integral_per_s: Range,
    /// kp of each joint in N·m/rad, in place of the natural frequency.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stiffness_nm_rad: Option<Vec<f64>>,
    /// kd of each joint in N·m·s/rad, in place of the damping ratio.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damping_nm_s_rad: Option<Vec<f64>>,
}

impl Default for JointPd {
    fn default() -> Self {
        let ComputedTorque { natural_frequency_hz, damping_ratio, integral_per_s } =
            ComputedTorque::default();
        Self {
            natural_frequency_hz,
            damping_ratio,
            integral_per_s,
            stiffness_nm_rad: None,
            damping_nm_s_rad: None,
        }
    }
}

/// Gains of a controller that cancels the nominal arm's dynamics.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ComputedTorque {
    /// Interval of ω / 2π: kp = ω².
    pub natural_frequency_hz: Range,
    /// Interval of ζ: kd = 2 ζ ω.
    pub damping_ratio: Range,
    /// Interval of ki / kp, 1/s.
    pub integral_per_s: Range,
}

impl Default for ComputedTorque {
    fn default() -> Self {
        Self {
            natural_frequency_hz: Range::new(1.5, 3.0),
            damping_ratio: Range::new(0.7, 1.0),
            integral_per_s: Range::new(0.0, 0.0),
        }
    }
}

/// Gains of a controller that gives the hand the motion of a mass on a spring.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OperationalSpace {
    /// Interval of ω / 2π of the hand: kp = ω².
    pub natural_frequency_hz: Range,
    /// Interval of ζ: kd = 2 ζ ω.
    pub damping_ratio: Range,
    /// Interval of ω / 2π of the posture: kn = ω² and dn = 2 ω.
    pub posture_frequency_hz: Range,
    /// Whether the task has the hand's orientation, beside its position. Default: whether the arm
    /// has six joints at least.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orientation: Option<bool>,
}

impl Default for OperationalSpace {
    fn default() -> Self {
        let ComputedTorque { natural_frequency_hz, damping_ratio, .. } = ComputedTorque::default();
        Self {
            natural_frequency_hz,
            damping_ratio,
            posture_frequency_hz: Range::new(0.5, 1.0),
            orientation: None,
        }
    }
}

/// Gains of springs and dampers at the hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CartesianImpedance {
    /// Interval of the stiffness against displacements, N/m.
    pub stiffness_n_m: Range,
    /// Interval of the stiffness against turns, N·m/rad.
    pub stiffness_nm_rad: Range,
    /// Interval of ζ: kd = 2 ζ √kp, as of a mass of 1 kg and an inertia of 1 kg m².
    pub damping_ratio: Range,
    /// Interval of kn, N·m/rad. dn = 2 √kn.
    pub posture_nm_rad: Range,
    /// Whether the task has the hand's orientation, beside its position. Default: whether the arm
    /// has six joints at least.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orientation: Option<bool>,
}

impl Default for CartesianImpedance {
    fn default() -> Self {
        Self {
            stiffness_n_m: Range::new(300.0, 1500.0),
            stiffness_nm_rad: Range::new(20.0, 60.0),
            damping_ratio: Range::new(0.7, 1.0),
            posture_nm_rad: Range::new(5.0, 20.0),
            orientation: None,
        }
    }
}

impl Check for ControlLaw {
    fn check(&self, violations: &mut Violations) {
        match self {
            Self::JointPd(law) => violations.part("joint-pd", law),
            Self::ComputedTorque(law) => violations.part("computed-torque", law),
            Self::OperationalSpace(law) => violations.part("operational-space", law),
            Self::CartesianImpedance(law) => violations.part("cartesian-impedance", law),
        }
    }
}

impl Check for OperationalSpace {
    fn check(&self, violations: &mut Violations) {
        let frequencies = 0.01..=100.0;
        violations.interval("natural_frequency_hz", self.natural_frequency_hz, &frequencies);
        violations.interval("damping_ratio", self.damping_ratio, &(0.0..=10.0));
        violations.interval("posture_frequency_hz", self.posture_frequency_hz, &frequencies);
    }
}

impl Check for CartesianImpedance {
    fn check(&self, violations: &mut Violations) {
        violations.interval("stiffness_n_m", self.stiffness_n_m, &(1.0..=1e5));
        violations.interval("stiffness_nm_rad", self.stiffness_nm_rad, &(0.1..=1e4));
        violations.interval("damping_ratio", self.damping_ratio, &(0.0..=10.0));
        violations.interval("posture_nm_rad", self.posture_nm_rad, &(0.0..=1e4));
    }
}

impl Check for JointPd {
    fn check(&self, violations: &mut Violations) {
        let Self { natural_frequency_hz, damping_ratio, integral_per_s, .. } = *self;
        ComputedTorque { natural_frequency_hz, damping_ratio, integral_per_s }.check(violations);
        if let Some(stiffness) = &self.stiffness_nm_rad {
            violations.all_within("stiffness_nm_rad", stiffness, &(0.0..=1e6));
        }
        if let Some(damping) = &self.damping_nm_s_rad {
            violations.all_within("damping_nm_s_rad", damping, &(0.0..=1e5));
        }
    }
}

impl Check for ComputedTorque {
    fn check(&self, violations: &mut Violations) {
        violations.interval("natural_frequency_hz", self.natural_frequency_hz, &(0.01..=100.0));
        violations.interval("damping_ratio", self.damping_ratio, &(0.0..=10.0));
        violations.interval("integral_per_s", self.integral_per_s, &(0.0..=100.0));
    }
}

/// The fewest joints that place a hand, and the fewest that place and turn it.
const FEWEST_JOINTS: [usize; 2] = [3, 6];

/// Whether the task of an arm of `joints` joints has the hand's orientation. `asked` is what the
/// spec says.
pub(super) fn has_orientation(asked: Option<bool>, joints: usize) -> bool {
    asked.unwrap_or(joints >= FEWEST_JOINTS[1])
}

/// Refuses a task of the hand that an arm of `joints` joints cannot do. `field` is what needs it.
pub(super) fn check_task(
    field: &str,
    asked: Option<bool>,
    joints: usize,
    violations: &mut Violations,
) {
    let [to_place, to_turn] = FEWEST_JOINTS;
    if joints < to_place {
        let allowed = format!("left out: an arm of {joints} joints cannot place its hand freely");
        violations.add(field, "a task of the hand", allowed);
    } else if has_orientation(asked, joints) && joints < to_turn {
        let allowed =
            format!("false for an arm of {joints} joints, which cannot turn its hand freely");
        violations.add(&format!("{field}.orientation"), "true", allowed);
    }
}

impl ControlLaw {
    /// The explicit gains of the law, if it has some: stiffnesses and dampings.
    pub(super) fn explicit_gains(&self) -> [(&'static str, Option<&Vec<f64>>); 2] {
        let Self::JointPd(law) = self else {
            return [("stiffness_nm_rad", None), ("damping_nm_s_rad", None)];
        };
        [
            ("stiffness_nm_rad", law.stiffness_nm_rad.as_ref()),
            ("damping_nm_s_rad", law.damping_nm_s_rad.as_ref()),
        ]
    }

    /// Whether its task is one of the hand, and if so, whether it has the hand's orientation. The
    /// arm has `joints` joints.
    pub fn task(&self, joints: usize) -> Option<bool> {
        Some(has_orientation(self.asked_orientation()?.1, joints))
    }

    /// The name of a law of the hand, with what the spec says about the orientation.
    pub(super) fn asked_orientation(&self) -> Option<(&'static str, Option<bool>)> {
        match self {
            Self::JointPd(_) | Self::ComputedTorque(_) => None,
            Self::OperationalSpace(law) => Some(("operational-space", law.orientation)),
            Self::CartesianImpedance(law) => Some(("cartesian-impedance", law.orientation)),
        }
    }
}
