//! Torques that predictors add to those of a robot's own controller.

use evaluation::EvaluationError;
use evaluation::control::{ExpectedTorques, FeedForward, Pursuit, RobotTrials, Trial, summarize};
use serde_json::json;
use spec::{ControlBaseline, ControlSpec, JobSpec, SimulateSpec};
use wire::{ControllerInfo, PredictorKind};

use crate::JOINTS;

/// Pandas as they are used, for a second before control and half a second under it.
fn arms() -> SimulateSpec {
    let text = json!({"preset": "panda-real", "trajectories": 8, "samples": 120, "seed": 4});
    match spec::parse(text.to_string().as_bytes()).unwrap() {
        JobSpec::Simulate(spec) => spec,
        _ => panic!("not a simulation"),
    }
}

fn control() -> ControlSpec {
    let text = json!({
        "kind": "control", "data": {"dataset": 1}, "context": 60, "duration_s": 0.5, "robots": 6,
        "bootstrap": {"resamples": 200},
    });
    match spec::parse(text.to_string().as_bytes()).unwrap() {
        JobSpec::Control(spec) => spec,
        _ => panic!("not a control job"),
    }
}

fn info(name: &str) -> ControllerInfo {
    ControllerInfo { name: name.to_owned(), kind: PredictorKind::Baseline, digest: None }
}

#[test]
fn who_knows_the_arm_better_follows_better_and_the_report_says_how_far_it_goes() {
    let (arms, spec) = (arms(), control());
    let pursuit = Pursuit::new(&spec, &arms).unwrap();
    let all = ControlBaseline::all();
    let robots: Vec<RobotTrials> = (0..u64::from(spec.robots))
        .map(|robot| {
            let pursued = pursuit.pursued(robot).unwrap();
            let trial = |&name: &ControlBaseline| {
                let feed_forward = FeedForward::baseline(name, &arms, pursued.robot());
                pursuit.run(&pursued, &feed_forward).trial
            };
            let trials: Vec<Trial> = all.iter().map(trial).collect();
            RobotTrials { robot, joints: JOINTS, threads: 1, trials, warnings: Vec::new() }
        })
        .collect();
    let infos = all.iter().map(|name| info(name.as_str())).collect();
    let report = summarize(&spec, &arms, infos, &robots);
    assert!(report.planner.is_none() && report.path.is_none());
    let rms: Vec<f64> =
        report.controllers.iter().map(|controller| controller.rms_deg.unwrap().mean).collect();
    let [alone, _, nominal, identified, oracle] = <[f64; 5]>::try_from(rms.clone()).unwrap();
    assert!(oracle < identified && identified < nominal && nominal < alone, "{rms:?}");
    assert!(oracle < 0.5 * alone, "{rms:?}");
    let shares: Vec<f64> =
        report.controllers.iter().map(|controller| controller.oracle_share.unwrap()).collect();
    let expected = (nominal - identified) / (nominal - oracle);
    assert!((shares[3] - expected).abs() < 1e-12, "{shares:?}");
    assert!(shares[0] < 0.0 && shares[2].abs() < 1e-12 && (shares[4] - 1.0).abs() < 1e-12);
}

#[test]
fn without_added_torques_the_robot_moves_as_in_the_data() {
    let (arms, spec) = (arms(), control());
    let pursuit = Pursuit::new(&spec, &arms).unwrap();
    let recorded =
        dynamics::simulate(&arms, 3..4, &|_| std::ops::ControlFlow::Continue(())).unwrap();
    let pursued = pursuit.pursued(3).unwrap();
    let alone = FeedForward::baseline(ControlBaseline::ZeroTorque, &arms, pursued.robot());
    let ran = pursuit.run(&pursued, &alone);
    assert_eq!(ran.trace.torques.len(), 30);
    let torques: Vec<f32> = ran.trace.torques.iter().flatten().copied().collect();
    let positions: Vec<f32> = ran.trace.positions.iter().flatten().copied().collect();
    assert_eq!(torques, recorded.series.true_u()[60 * JOINTS..90 * JOINTS]);
    assert_eq!(positions, recorded.series.true_y()[61 * JOINTS..91 * JOINTS]);
}

#[test]
fn a_predictor_is_asked_about_the_reference_and_fails_with_its_reason() {
    let (arms, spec) = (arms(), control());
    let pursuit = Pursuit::new(&spec, &arms).unwrap();
    let pursued = pursuit.pursued(0).unwrap();
    let said = |torque: f64| FeedForward {
        name: "says".to_owned(),
        torques: ExpectedTorques::Said(Box::new(move |observed, motion| {
            assert_eq!((observed.context(), motion.joints()), (60, JOINTS));
            // 1020 control periods a second, to the end of the data.
            assert_eq!(motion.instants(), 60 * 17);
            Ok(vec![torque; motion.q().len()])
        })),
    };
    assert!(pursuit.run(&pursued, &said(0.0)).trial.tracking.is_some());
    let lost = pursuit.run(&pursued, &said(f64::NAN)).trial;
    assert!(lost.tracking.is_none() && lost.failure.is_some(), "{lost:?}");
    let silent = FeedForward {
        name: "silent".to_owned(),
        torques: ExpectedTorques::Said(Box::new(|_, _| {
            Err(EvaluationError::SaysNoTorques { predictor: "silent".to_owned() })
        })),
    };
    let reason = pursuit.run(&pursued, &silent).trial.failure.unwrap();
    assert!(reason.contains("silent") && reason.contains("no torques"), "{reason}");
}
