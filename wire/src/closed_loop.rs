//! The report of a control job: how well each controller followed the path.
//!
//! The last task of a control job writes it as `report.json`.

use serde::{Deserialize, Serialize};
use spec::{Bootstrap, ControlPath, Digest, Planner};
use utoipa::ToSchema;

use crate::{Interval, PredictorKind, Warning};

/// The result of a control job, as it is stored, shown and downloaded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ControlReport {
    pub robots: u64,
    /// Samples of control per robot.
    pub steps: u32,
    pub rate_hz: f64,
    /// Samples of excitation before control begins.
    pub context: u32,
    pub path: ControlPath,
    pub planner: Planner,
    pub bootstrap: Bootstrap,
    pub controllers: Vec<ControllerSummary>,
    /// Each checkpoint against each controller before it, and each other controller against the one
    /// before it.
    pub paired: Vec<ControlDifference>,
    /// Torques, positions and rates of the excitation and of the motions that a checkpoint led to, outside of
    /// what it was trained on. None of checkpoints that do not say what they were trained on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// The name of a controller, its kind and its training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ControllerInfo {
    pub name: String,
    pub kind: PredictorKind,
    /// The digest of the spec that a checkpoint was trained by.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<Digest>,
}

/// Means over robots. A controller that failed on one of them has none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ControllerSummary {
    #[serde(flatten)]
    pub info: ControllerInfo,
    /// RMS tracking error, mean over joints, in degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms_deg: Option<Interval>,
    /// RMS tracking error in degrees, a value per joint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_rms_deg: Option<Vec<f64>>,
    /// Mean over robots of the largest error of any joint, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_deg: Option<f64>,
    /// Root mean square over time and joints, N·m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub torque_rms_nm: Option<f64>,
    /// Share of torques larger than 99 % of the excitation's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beyond_excitation: Option<f64>,
    /// The least distance of any robot to a joint limit, rad; negative beyond it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clearance_rad: Option<f64>,
    /// The time that one plan takes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<PlanTime>,
    /// Robots that it failed on.
    pub failed: u64,
    /// The reason on the first of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
}

/// Times that plans took, beside whatever else the machine had to do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanTime {
    pub median_ms: f64,
    pub p99_ms: f64,
    /// Threads that computed.
    pub threads: u64,
}

/// The difference between two controllers on the same robots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ControlDifference {
    pub controller: String,
    pub against: String,
    /// RMS tracking error of `controller` less that of `against`; negative is better.
    pub difference_deg: Interval,
}
