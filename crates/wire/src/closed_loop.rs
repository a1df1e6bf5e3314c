//! The report of a control job: how well each controller followed the path.
//!
//! The last task of a control job writes it as `report.json`.

use serde::{Deserialize, Serialize};
use spec::{Bootstrap, ControlPath, Digest, Planner};
use utoipa::ToSchema;

use crate::measures::measures;
use crate::{Interval, PredictorKind, Warning};

/// The result of a control job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ControlReport {
    /// Number of robots, the same for every controller.
    pub robots: u64,
    /// Number of control samples per robot.
    pub steps: u32,
    /// Control samples per second.
    pub rate_hz: f64,
    /// Samples before control begins.
    pub context: u32,
    /// The path that the robots should follow. Missing for robots with controllers of their own,
    /// which follow their references.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<ControlPath>,
    /// How the controllers plan their torques. Missing for robots with controllers of their own, to
    /// whose torques others are added.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub planner: Option<Planner>,
    /// How the intervals are resampled.
    pub bootstrap: Bootstrap,
    /// The controllers, in the order of every table.
    pub controllers: Vec<ControllerSummary>,
    /// Differences between controllers. Each checkpoint is compared with every controller before
    /// it, and each other controller with the one before it.
    pub paired: Vec<ControlDifference>,
    /// Torques, positions and rates that lie outside a checkpoint's training data, in the
    /// excitation and in the motions under its control. A checkpoint that does not record its
    /// training data has no warnings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// The name of a controller, its kind and its training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ControllerInfo {
    /// The name in tables.
    pub name: String,
    /// Whether it plans with a baseline or with a checkpoint.
    pub kind: PredictorKind,
    /// The digest of the spec that trained a checkpoint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<Digest>,
}

measures! {
    /// Means over robots. They are missing for a controller that failed on any robot.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
    pub struct ControllerSummary {
        /// The controller.
        #[serde(flatten)]
        pub info: ControllerInfo,
        /// RMS tracking error, mean over joints, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub rms_deg: Option<Interval> = Control "RMS" Degrees,
        /// The part of the way from the error of `nominal-simulator` to that of `oracle` by which this
        /// controller's error is smaller: 0 is as large as the one, and 1 as small as the other.
        /// Reports have it where torques are added to those of the robots' own controllers.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub oracle_share: Option<f64> = Control "of the way to oracle" Share,
        /// RMS tracking error in degrees, a value per joint.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub joint_rms_deg: Option<Vec<f64>>,
        /// Mean over robots of the largest error of any joint, degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub peak_deg: Option<f64> = Control "largest" Degrees,
        /// Root mean square of the torques over time and joints, N·m.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub torque_rms_nm: Option<f64> = Control "torque RMS" NewtonMetres,
        /// Share of torques that are larger than 99 % of the excitation's torques.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub beyond_excitation: Option<f64> = Control "beyond excitation" Share,
        /// The smallest distance of any robot to a joint limit, rad; negative if a limit was exceeded.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub clearance_rad: Option<f64> = Control "clearance" Radians,
        /// The computing time of one plan, or of all torques that are added.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub plan: Option<PlanTime>,
        /// Number of robots on which the controller failed.
        pub failed: u64,
        /// The reason for the first failure.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub failure: Option<String>,
    }
}

/// Computing times of plans, measured while the machine also did other work.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanTime {
    /// Median of the times, ms.
    pub median_ms: f64,
    /// 99th percentile of the times, ms.
    pub p99_ms: f64,
    /// Number of threads that computed.
    pub threads: u64,
}

/// The difference between two controllers on the same robots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ControlDifference {
    /// The name of one controller.
    pub controller: String,
    /// The name of the other.
    pub against: String,
    /// RMS tracking error of `controller` minus that of `against`. Negative is better.
    pub difference_deg: Interval,
}
