//! All trials together: means over robots with their intervals.

use dynamics::Joints;
use serde::{Deserialize, Serialize};
use spec::{Bootstrap, ControlPath, ControlSpec, Digest, JOINTS, Planner};

use super::{RobotTrials, Tracking, Trial};
use crate::{Interval, PredictorKind, stratified_mean};

/// The result of a control job, as it is stored, shown and downloaded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlReport {
    pub robots: usize,
    /// Samples of control per robot.
    pub steps: u32,
    pub rate_hz: f64,
    pub context: u32,
    pub path: ControlPath,
    pub planner: Planner,
    pub bootstrap: Bootstrap,
    pub controllers: Vec<ControllerSummary>,
    /// Each checkpoint less each controller before it, and each controller less the one before it.
    pub paired: Vec<ControlDifference>,
}

/// Who a controller is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControllerInfo {
    pub name: String,
    pub kind: PredictorKind,
    /// Digest of the training's spec.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<Digest>,
}

/// Means over robots; none of a controller that failed on one of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControllerSummary {
    #[serde(flatten)]
    pub info: ControllerInfo,
    /// Of the tracking error, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms_deg: Option<Interval>,
    /// The same of each joint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_rms_deg: Option<Joints<f64>>,
    /// Mean over robots of the largest error of any joint, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_deg: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub torque_rms_nm: Option<f64>,
    /// Share of torques larger than 99 % of the excitation's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beyond_excitation: Option<f64>,
    /// Of all robots the least distance to a joint limit, rad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clearance_rad: Option<f64>,
    /// Of one plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<PlanTime>,
    /// Robots that it failed on.
    pub failed: usize,
    /// Of the first of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
}

/// How long plans took, with whatever else the machine had to do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanTime {
    pub median_ms: f64,
    pub p99_ms: f64,
    /// That computed.
    pub threads: usize,
}

/// RMS tracking error of one controller less that of another on the same robots; below 0 is better.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlDifference {
    pub controller: String,
    pub against: String,
    pub difference_deg: Interval,
}

/// Puts the robots of a job together; `controllers` in the order of its tables, in which every robot
/// has its trials.
pub fn summarize(
    spec: &ControlSpec,
    rate_hz: f64,
    controllers: Vec<ControllerInfo>,
    robots: &[RobotTrials],
) -> ControlReport {
    let is_learned = |info: &ControllerInfo| info.kind == PredictorKind::Checkpoint;
    let mut paired = Vec::new();
    for (k, ours) in controllers.iter().enumerate() {
        let neighbour = k.saturating_sub(1);
        let against = if is_learned(ours) { &controllers[..k] } else { &controllers[neighbour..k] };
        paired.extend(against.iter().filter_map(|theirs| {
            Some(ControlDifference {
                controller: ours.name.clone(),
                against: theirs.name.clone(),
                difference_deg: difference(robots, &ours.name, &theirs.name, spec.bootstrap)?,
            })
        }));
    }
    ControlReport {
        robots: robots.len(),
        steps: spec.steps(rate_hz),
        rate_hz,
        context: spec.context,
        path: spec.path.clone(),
        planner: spec.planner.clone(),
        bootstrap: spec.bootstrap,
        controllers: controllers.into_iter().map(|info| of(info, robots, spec.bootstrap)).collect(),
        paired,
    }
}

fn of(info: ControllerInfo, robots: &[RobotTrials], bootstrap: Bootstrap) -> ControllerSummary {
    let trials: Vec<(&Trial, usize)> = robots
        .iter()
        .flat_map(|robot| robot.trials.iter().map(|trial| (trial, robot.threads)))
        .filter(|(trial, _)| trial.controller == info.name)
        .collect();
    let tracked: Option<Vec<&Tracking>> =
        trials.iter().map(|(trial, _)| trial.tracking.as_ref()).collect();
    let tracked = tracked.filter(|tracked| !tracked.is_empty());
    let mean = |value: &dyn Fn(&Tracking) -> f64| {
        let tracked = tracked.as_ref()?;
        Some(tracked.iter().map(|it| value(it)).sum::<f64>() / tracked.len() as f64)
    };
    let rms_deg = tracked.as_ref().map(|tracked| {
        stratified_mean(&[tracked.iter().map(|it| it.rms_deg).collect()], bootstrap)
    });
    let clearances = tracked.iter().flatten().map(|it| it.clearance_rad);
    let failures = || trials.iter().filter_map(|(trial, _)| trial.failure.as_ref());
    ControllerSummary {
        rms_deg,
        joint_rms_deg: tracked.is_some().then(|| {
            let mut joints = [0.0; JOINTS];
            for (joint, rms) in joints.iter_mut().enumerate() {
                *rms = mean(&|it| it.joint_rms_deg[joint]).unwrap_or(f64::NAN);
            }
            joints
        }),
        peak_deg: mean(&|it| it.peak_deg),
        torque_rms_nm: mean(&|it| it.torque_rms_nm),
        beyond_excitation: mean(&|it| it.beyond_excitation),
        clearance_rad: clearances.min_by(f64::total_cmp),
        plan: plan_time(&trials),
        failed: failures().count(),
        failure: failures().next().cloned(),
        info,
    }
}

/// Of all plans of all robots.
fn plan_time(trials: &[(&Trial, usize)]) -> Option<PlanTime> {
    let mut times: Vec<f64> =
        trials.iter().flat_map(|(trial, _)| trial.plan_ms.iter().copied()).collect();
    times.sort_by(f64::total_cmp);
    let at =
        |per_cent: usize| times.get((times.len() * per_cent / 100).min(times.len().max(1) - 1));
    let threads = trials.iter().map(|(_, threads)| *threads).max()?;
    Some(PlanTime { median_ms: *at(50)?, p99_ms: *at(99)?, threads })
}

/// `None` when either failed on a robot.
fn difference(
    robots: &[RobotTrials],
    ours: &str,
    theirs: &str,
    bootstrap: Bootstrap,
) -> Option<Interval> {
    let rms_deg = |robot: &RobotTrials, name: &str| {
        let trial = robot.trials.iter().find(|trial| trial.controller == name)?;
        Some(trial.tracking.as_ref()?.rms_deg)
    };
    let differences: Option<Vec<f64>> =
        robots.iter().map(|robot| Some(rms_deg(robot, ours)? - rms_deg(robot, theirs)?)).collect();
    let differences = differences.filter(|differences| !differences.is_empty())?;
    Some(stratified_mean(&[differences], bootstrap))
}
