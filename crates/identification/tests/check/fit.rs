//! Tests the warnings of an identification from logs with mistakes.

use std::ops::ControlFlow;

use identification::{Recording, Settings, identify};

use super::generated::{Log, arm, drawn};

/// The warnings of a fit to torques, but for parameters that are hardly seen.
fn warnings(recording: Recording, settings: &Settings) -> Vec<String> {
    let described = arm(4);
    let unheard = &mut || ControlFlow::Continue(());
    let found = identify(&described, &[recording], &[], settings, unheard).unwrap();
    let warnings = found.report.warnings.into_iter();
    warnings.filter(|warning| !warning.contains("hardly seen")).collect()
}

fn torques_only() -> Settings {
    Settings { motion_steps: 0, ..Settings::default() }
}

/// The warnings after a mistake in a log.
fn after(change: impl Fn(&mut Log)) -> Vec<String> {
    let mut log = Log::of(&drawn(&arm(4), 5), 5);
    change(&mut log);
    warnings(log.recording(), &torques_only())
}

fn assert_said(warnings: &[String], parts: &[&str]) {
    for part in parts {
        assert!(
            warnings.iter().any(|warning| warning.contains(part)),
            "{part:?} is not in {warnings:#?}"
        );
    }
}

#[test]
fn a_log_of_the_arm_gives_no_warnings() {
    assert_eq!(after(|_| {}), [""; 0]);
}

#[test]
fn torques_that_are_left_are_named_with_their_joint() {
    let look = "the recordings do not fit the arm: look at columns, signs, units, gains and zero positions of";
    let exchanged = after(|log| log.u_columns.swap(1, 3));
    assert_said(
        &exchanged,
        &[
            "columns of u look exchanged: joint 2 fits column 4, joint 4 fits column 2",
            "N·m of the torque of joint 2, whose standard deviation is",
            "N·m of the torque of joint 4, whose standard deviation is",
            &format!("{look} joints 2 and 4"),
        ],
    );
    let turned = after(|log| log.u_factors[1] = -1.0);
    assert_said(&turned, &["u of joint 2 seems to have the other sign", &format!("{look} joint")]);
    let millis = after(|log| log.u_factors.fill(1e3));
    assert_said(&millis, &["is it in mN·m?", look]);
}

#[test]
fn zero_torques_and_other_zero_positions_are_named() {
    let log = || Log::of(&drawn(&arm(4), 5), 5).recording();
    let mut silent = log();
    silent.u.iter_mut().for_each(|row| row[1] = 0.0);
    let said = warnings(silent, &torques_only());
    assert_said(&said, &["u of joint 2 is constant", "whose standard deviation is 0 N·m"]);
    let mut turned = log();
    turned.q.iter_mut().for_each(|row| row[1] += std::f64::consts::FRAC_PI_2);
    let said = warnings(turned, &torques_only());
    assert_said(&said, &["of the torque of joint 2", "the recordings do not fit the arm"]);
}

#[test]
fn doubts_that_a_fit_settles_itself_are_left_out() {
    let mut log = Log::of(&drawn(&arm(4), 5), 5);
    log.delay_s = 0.03;
    let late = warnings(log.recording(), &torques_only());
    assert_said(&late, &["to be recorded"]);
    let settings = Settings { most_delay_s: 0.05, ..torques_only() };
    let found = warnings(log.recording(), &settings);
    assert!(found.iter().all(|warning| !warning.contains("to be recorded")), "{found:?}");

    let mut log = Log::of(&drawn(&arm(4), 5), 5);
    log.u_factors.fill(2.0);
    let scaled = warnings(log.recording(), &torques_only());
    assert_said(&scaled, &["times the arm's torque"]);
    let settings = Settings { gain_deviation: 0.4, ..torques_only() };
    let found = warnings(log.recording(), &settings);
    assert!(found.iter().all(|warning| !warning.contains("times the arm's")), "{found:?}");
}

/// A single parabola with a wide step was off by up to 3 of its standard deviations.
#[test]
fn a_delay_beside_strong_friction_is_as_uncertain_as_it_says() {
    const ARMS: u32 = 8;

    for delay_s in [0.0, 0.008] {
        let (mut squares_s2, mut squares) = (0.0, 0.0);
        for seed in 0..ARMS {
            let mut truth = drawn(&arm(3), seed.into());
            for joint in &mut truth.joints {
                joint.friction.as_mut().unwrap().phi2_s_rad = 100.0;
            }
            let mut log = Log::of(&truth, seed.into());
            log.delay_s = delay_s;
            let settings = Settings { most_delay_s: 0.05, ..torques_only() };
            let unheard = &mut || ControlFlow::Continue(());
            let found = identify(&arm(3), &[log.recording()], &[], &settings, unheard).unwrap();
            let delay = found.report.parameters.last().unwrap();
            let error_s = delay.value - delay_s;
            squares_s2 += error_s.powi(2) / f64::from(ARMS);
            squares += (error_s / delay.deviation).powi(2) / f64::from(ARMS);
        }
        let (error_s, of_deviations) = (squares_s2.sqrt(), squares.sqrt());
        println!("{delay_s} s: {error_s} s, {of_deviations} standard deviations");
        assert!(error_s < 1e-4, "{delay_s} s: {error_s} s");
        assert!((0.3..1.6).contains(&of_deviations), "{delay_s} s: {of_deviations}");
    }
}

#[test]
fn torques_without_the_weight_are_named() {
    let said = after(|log| log.gravity = 0.0);
    assert_said(&said, &["comes without the arm's weight"]);
}
