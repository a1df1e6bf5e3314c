//! The report of a control job, as its last task writes it and the page reads it.

use serde::Deserialize;
use spec::{Digest, JOINTS, Planner};

use crate::app::{App, Interval, Job, PredictorKind};
use crate::error::ApiError;

#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct ControlReport {
    pub robots: u64,
    /// Samples of control per robot.
    pub steps: u32,
    pub rate_hz: f64,
    pub context: u32,
    pub planner: Planner,
    pub controllers: Vec<ReportedController>,
    pub paired: Vec<ControlDifference>,
}

/// Means over robots; none of a controller that failed on one of them.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct ReportedController {
    pub name: String,
    pub kind: PredictorKind,
    #[serde(default)]
    pub digest: Option<Digest>,
    #[serde(default)]
    pub rms_deg: Option<Interval>,
    #[serde(default)]
    pub joint_rms_deg: Option<[f64; JOINTS]>,
    #[serde(default)]
    pub peak_deg: Option<f64>,
    #[serde(default)]
    pub torque_rms_nm: Option<f64>,
    #[serde(default)]
    pub beyond_excitation: Option<f64>,
    #[serde(default)]
    pub clearance_rad: Option<f64>,
    #[serde(default)]
    pub plan: Option<PlanTime>,
    pub failed: u64,
    #[serde(default)]
    pub failure: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct PlanTime {
    pub median_ms: f64,
    pub p99_ms: f64,
    pub threads: u64,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct ControlDifference {
    pub controller: String,
    pub against: String,
    pub difference_deg: Interval,
}

impl App {
    /// What a control job found; `None` before its end, and of another version's report.
    pub async fn control_report(&self, job: &Job) -> Result<Option<ControlReport>, ApiError> {
        let report = self.report(job.id).await?;
        Ok(report.and_then(|report| serde_json::from_value(report).ok()))
    }
}
