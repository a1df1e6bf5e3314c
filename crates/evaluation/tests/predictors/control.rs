//! Closed loops on simulated arms.

use std::ops::ControlFlow;

use dynamics::Joints;
use evaluation::control::{
    Controller, Experiment, Foreseen, Plant, RobotTrials, Trace, Trial, summarize,
};
use evaluation::{EvaluationError, Predictor};
use serde_json::{Value, json};
use series::Observed;
use spec::{ControlBaseline, ControlSpec, JobSpec, SimulateSpec};
use wire::{ControllerInfo, PredictorKind};

use super::simulation;

use crate::JOINTS;

/// A second of control after a third of a second of excitation.
fn control(fields: &Value) -> ControlSpec {
    let mut text = json!({
        "kind": "control", "data": {"dataset": 1}, "context": 20, "duration_s": 1.0, "seed": 5,
        "path": {"swing": {"frequency_hz": vec![0.4; JOINTS]}},
        "planner": {"samples": 32, "horizon": 20, "knot_every": 10},
        "bootstrap": {"resamples": 200},
    });
    text.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    match spec::parse(text.to_string().as_bytes()).unwrap() {
        JobSpec::Control(spec) => spec,
        _ => panic!("not a control job"),
    }
}

fn arms() -> SimulateSpec {
    simulation(60, &json!({}))
}

fn run(spec: &ControlSpec, robot: u64, baseline: ControlBaseline) -> (Trial, Trace) {
    let arms = arms();
    let experiment = Experiment::new(spec, &arms);
    let plant = experiment.plant(robot).unwrap();
    let controller = Controller::baseline(baseline, &arms, plant.robot());
    let go_on = |_| ControlFlow::Continue(());
    let ran = experiment.run(robot, plant, &controller, &go_on).unwrap();
    (ran.trial, ran.trace)
}

fn rms_deg(trial: &Trial) -> f64 {
    trial.tracking.as_ref().unwrap().rms_deg
}

#[test]
fn who_knows_the_robot_follows_the_path_best_and_who_does_nothing_is_left_behind() {
    let spec = control(&json!({}));
    let mean = |baseline| {
        let robots = 0..4;
        robots.map(|robot| rms_deg(&run(&spec, robot, baseline).0)).sum::<f64>() / 4.0
    };
    let [still, integrator, nominal, oracle] =
        <[ControlBaseline; 4]>::try_from(ControlBaseline::usual()).unwrap().map(mean);
    assert!(oracle < 0.2 * still, "{oracle} beside {still}");
    assert!(oracle < 0.8 * integrator, "{oracle} beside {integrator}");
    assert!(oracle < 1.1 * nominal && nominal < integrator, "{oracle}, {nominal}, {integrator}");
}

#[test]
fn a_trial_has_the_same_bits_with_any_number_of_threads() {
    let spec = control(&json!({}));
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&spec, 1, ControlBaseline::Oracle))
    };
    let (one, trace) = on(1);
    let (three, again) = on(3);
    assert!(trace == again);
    assert_eq!(one.tracking, three.tracking);
    let (_, other) = run(&control(&json!({"seed": 6})), 1, ControlBaseline::Oracle);
    assert!(trace != other);
}

#[test]
fn the_robot_goes_on_from_its_excitation_as_if_nothing_had_happened() {
    let arms = arms();
    let recorded = dynamics::simulate(&arms, 3..4, &|_| ControlFlow::Continue(())).unwrap();
    let torques: Vec<_> = recorded.series.u().chunks_exact(JOINTS).map(Joints::from).collect();
    let mut plant = Plant::excited(&arms, 3, 20).unwrap();
    assert_eq!(plant.now().y.len(), 21);
    for torques in torques[20..59].chunks(7) {
        plant.apply(torques);
    }
    let positions: Vec<f32> = plant.now().y.iter().flatten().copied().collect();
    assert_eq!(positions.len(), recorded.series.y().len());
    for (replayed, recorded) in positions.iter().zip(recorded.series.y()) {
        assert!((replayed - recorded).abs() < 2e-6, "{replayed} {recorded}");
    }
}

/// Answers with the number of the last known sample, which shows the question.
struct Probe;

impl Predictor for Probe {
    fn name(&self) -> &str {
        "probe"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        assert_eq!((observed.context(), observed.horizon()), (4, 6));
        let asked = |scenario: usize| {
            let torques: Vec<f32> = observed.u(scenario).joint(0).collect();
            // Three torques of the past, a plan of two, and its last torque held.
            assert_eq!(torques[..3], [7., 8., 9.]);
            let plan = &torques[3..];
            let (first, second) = (plan[0], plan[1]);
            assert!(plan[2..].iter().all(|u| *u == second), "{plan:?}");
            let last = observed.y(scenario)[3][0];
            [[last + first; JOINTS], [last + second; JOINTS], [f32::NAN; JOINTS]]
        };
        let answer = |scenario| {
            let [first, second, beyond] = asked(scenario);
            [first, second, beyond, beyond, beyond, beyond]
        };
        Ok((0..observed.robots()).flat_map(answer).flatten().collect())
    }
}

#[test]
fn a_predictor_is_asked_about_the_latest_samples_and_heard_as_far_as_the_plan_goes() {
    use dynamics::ArmState;
    use evaluation::control::{Forecast, Now};
    let u: Vec<_> = (0..10_u8).map(|k| Joints::splat(JOINTS, f32::from(k))).collect();
    let y: Vec<_> = (0..11_u8).map(|k| Joints::splat(JOINTS, 100.0 * f32::from(k))).collect();
    let now = Now { u: &u, y: &y, state: &ArmState::default() };
    let forecast = Foreseen { predictor: Probe, context: 4, horizon: Some(6), rate_hz: 60.0 };
    let plans = [1.0, 2.0, 3.0, 4.0].map(|torque| Joints::splat(JOINTS, torque));
    let answer = forecast.foresee(&now, &plans, 2).unwrap();
    let firsts: Vec<f32> = answer.iter().map(|q| q[0]).collect();
    assert_eq!(firsts, [1001., 1002., 1003., 1004.]);
}

/// Answers for a while, then fails.
struct Breaks;

impl Predictor for Breaks {
    fn name(&self) -> &str {
        "breaks"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        let turned = observed.y(0)[0][0] != observed.y(0)[3][0];
        let value = if turned { f32::NAN } else { 0.0 };
        Ok(vec![value; observed.robots() * observed.horizon() * JOINTS])
    }
}

#[test]
fn a_predictor_without_an_answer_is_reported_and_averaged_with_nothing() {
    let arms = arms();
    let spec = control(&json!({}));
    let experiment = Experiment::new(&spec, &arms);
    let forecast = Foreseen { predictor: Breaks, context: 4, horizon: None, rate_hz: 60.0 };
    let controller = Controller { name: "breaks".to_owned(), forecast: Some(Box::new(forecast)) };
    let plant = experiment.plant(0).unwrap();
    let go_on = |_| ControlFlow::Continue(());
    let broken = experiment.run(0, plant, &controller, &go_on).unwrap().trial;
    assert_eq!(broken.tracking, None);
    let reason = broken.failure.clone().unwrap();
    assert!(reason.contains("sample 0") && reason.contains("not finite"), "{reason}");

    let (oracle, _) = run(&spec, 0, ControlBaseline::Oracle);
    let robots = [RobotTrials {
        robot: 0,
        joints: JOINTS,
        threads: 1,
        trials: vec![oracle, broken],
        warnings: Vec::new(),
    }];
    let info = |name: &str| ControllerInfo {
        name: name.to_owned(),
        kind: PredictorKind::Baseline,
        digest: None,
    };
    let report = summarize(&spec, &arms, vec![info("oracle"), info("breaks")], &robots);
    assert!(report.controllers[0].rms_deg.is_some());
    assert_eq!((report.controllers[1].rms_deg, report.controllers[1].failed), (None, 1));
    assert!(report.paired.is_empty());
}

#[test]
fn a_trial_ends_when_it_is_told_to() {
    let arms = arms();
    let spec = control(&json!({}));
    let experiment = Experiment::new(&spec, &arms);
    let plant = experiment.plant(0).unwrap();
    let controller = Controller::baseline(ControlBaseline::Oracle, &arms, plant.robot());
    let stop_at_8 =
        |samples| if samples < 8 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
    assert!(experiment.run(0, plant, &controller, &stop_at_8).is_none());
}
