//! The summary of all trials: means over robots with their intervals.

use spec::{Bootstrap, ControlBaseline, ControlSpec, SimulateSpec};
use wire::{
    ControlDifference, ControlReport, ControllerInfo, ControllerSummary, Interval, PlanTime,
    PredictorKind, Warning,
};

use super::tracking::Tracking;
use super::trial::{RobotTrials, Trial};
use crate::bootstrap::stratified_mean;

/// Summarizes the robots of a job, whose data is `simulation`. `controllers` has the order of the
/// tables, and every robot has their trials.
pub fn summarize(
    spec: &ControlSpec,
    simulation: &SimulateSpec,
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
    let rate_hz = simulation.rate_hz;
    let plans = simulation.controller.is_none();
    let mut controllers: Vec<ControllerSummary> =
        controllers.into_iter().map(|info| of(info, robots, spec.bootstrap)).collect();
    if !plans {
        set_oracle_shares(&mut controllers);
    }
    ControlReport {
        robots: robots.len() as u64,
        steps: spec.steps(rate_hz),
        rate_hz,
        context: spec.context,
        path: plans.then(|| spec.path.clone()),
        planner: plans.then(|| spec.planner.clone()),
        bootstrap: spec.bootstrap,
        controllers,
        paired,
        warnings: Warning::merge(robots.iter().flat_map(|robot| robot.warnings.iter().cloned())),
    }
}

/// Says how far each controller goes from the nominal arm's error to the oracle's.
fn set_oracle_shares(controllers: &mut [ControllerSummary]) {
    let mean_deg = |name: ControlBaseline| {
        let found = controllers.iter().find(|controller| controller.info.name == name.as_str());
        Some(found?.rms_deg?.mean)
    };
    let nominal = mean_deg(ControlBaseline::NominalSimulator);
    let oracle = mean_deg(ControlBaseline::Oracle);
    let (Some(nominal), Some(oracle)) = (nominal, oracle) else { return };
    if oracle < nominal {
        for controller in controllers {
            let share = |rms: Interval| (nominal - rms.mean) / (nominal - oracle);
            controller.oracle_share = controller.rms_deg.map(share);
        }
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
        Some(tracked.iter().map(|tracking| value(tracking)).sum::<f64>() / tracked.len() as f64)
    };
    let rms_deg = tracked.as_ref().map(|tracked| {
        stratified_mean(&[tracked.iter().map(|tracking| tracking.rms_deg).collect()], bootstrap)
    });
    let clearances = tracked.iter().flatten().map(|tracking| tracking.clearance_rad);
    let failures = || trials.iter().filter_map(|(trial, _)| trial.failure.as_ref());
    ControllerSummary {
        rms_deg,
        oracle_share: None,
        joint_rms_deg: (0..robots.first().map_or(0, |robot| robot.joints))
            .map(|joint| mean(&|tracking| tracking.joint_rms_deg[joint]))
            .collect(),
        peak_deg: mean(&|tracking| tracking.peak_deg),
        torque_rms_nm: mean(&|tracking| tracking.torque_rms_nm),
        beyond_excitation: mean(&|tracking| tracking.beyond_excitation),
        clearance_rad: clearances.min_by(f64::total_cmp),
        plan: plan_time(&trials),
        failed: failures().count() as u64,
        failure: failures().next().cloned(),
        info,
    }
}

/// The time of all plans of all robots.
fn plan_time(trials: &[(&Trial, usize)]) -> Option<PlanTime> {
    let mut times: Vec<f64> =
        trials.iter().flat_map(|(trial, _)| trial.plan_ms.iter().copied()).collect();
    times.sort_by(f64::total_cmp);
    let at =
        |per_cent: usize| times.get((times.len() * per_cent / 100).min(times.len().max(1) - 1));
    let threads = trials.iter().map(|(_, threads)| *threads).max()?;
    Some(PlanTime { median_ms: *at(50)?, p99_ms: *at(99)?, threads: threads as u64 })
}

/// The difference of two controllers. `None` if either failed on a robot.
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
