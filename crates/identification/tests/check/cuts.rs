//! Torques that are cut off at a value.

use std::ops::ControlFlow;

use identification::{Recording, Settings, check_log, identify};

use super::generated::{Log, arm, drawn};

/// A log of a drawn arm whose torque of joint 2 is cut off at these shares of its highest and lowest
/// value.
fn cut(seed: u64, shares: (f64, f64)) -> Recording {
    let mut recording = Log::of(&drawn(&arm(3), seed), seed).recording();
    let torques = || recording.u.iter().map(|row| row[1]);
    let (lowest, highest) =
        (torques().fold(f64::MAX, f64::min), torques().fold(f64::MIN, f64::max));
    let middle = 0.5 * (lowest + highest);
    let (low, high) =
        (middle + shares.0 * (lowest - middle), middle + shares.1 * (highest - middle));
    recording.u.iter_mut().for_each(|row| row[1] = row[1].clamp(low, high));
    recording
}

fn doubts(recording: Recording) -> Vec<String> {
    check_log(&arm(3), &[recording]).unwrap().doubts
}

fn torques_only() -> Settings {
    Settings { motion_steps: 0, ..Settings::default() }
}

#[test]
fn a_torque_that_is_cut_off_is_named_with_its_value_and_share() {
    for seed in 0..4 {
        let recording = cut(seed, (0.5, 0.5));
        let highest = recording.u.iter().map(|row| row[1]).fold(f64::MIN, f64::max);
        let cut_off = recording.u.iter().filter(|row| row[1] == highest).count();
        let percent = 100.0 * cut_off as f64 / recording.u.len() as f64;
        let found = doubts(recording);
        let [doubt] = found.as_slice() else { panic!("{seed}: {found:#?}") };
        let begin = format!(
            "u of joint 2 stands at its highest value, {} N·m, in {percent:.0} % of the samples and at its lowest",
            format!("{highest:.2e}").parse::<f64>().unwrap()
        );
        assert!(doubt.starts_with(&begin), "{begin}: {doubt}");
        assert!(doubt.ends_with("is the torque cut off there?"), "{doubt}");
        let above = doubts(cut(seed, (1.0, 0.5)));
        assert!(above[0].contains("highest") && !above[0].contains("lowest"), "{above:#?}");
        let below = doubts(cut(seed, (0.5, 1.0)));
        assert!(below[0].contains("lowest") && !below[0].contains("highest"), "{below:#?}");
    }
}

#[test]
fn a_limit_that_is_rarely_reached_is_no_doubt() {
    for seed in 0..4 {
        assert_eq!(doubts(cut(seed, (0.99, 0.99))), [""; 0], "{seed}");
    }
}

/// A viscous friction of 1 N·m s/rad was identified as 0.025 ± 0.012 from a torque that was cut off in
/// two thirds of the samples.
#[test]
fn an_identification_leaves_out_torques_that_are_cut_off() {
    for shares in [(0.6, 0.6), (0.35, 0.35), (1.0, 0.3)] {
        let (mut inside, mut all) = (0, 0);
        for seed in 0..8 {
            let truth = drawn(&arm(3), seed);
            let recording = cut(seed, shares);
            let unheard = &mut || ControlFlow::Continue(());
            let found = identify(&arm(3), &[recording], &[], &torques_only(), unheard).unwrap();
            let warnings = &found.report.warnings;
            let left_out = "samples of the torque of joint 2, because it is cut off there";
            assert!(warnings.iter().any(|warning| warning.contains(left_out)), "{warnings:#?}");
            let told =
                warnings.iter().filter(|warning| warning.contains("fit leaves these samples"));
            assert_eq!(told.count(), 1, "{warnings:#?}");
            let of_joint = |name: &str| {
                let mut parameters = found.report.parameters.iter();
                parameters.find(|it| it.joint == Some(2) && it.name == name).unwrap()
            };
            let joint = &truth.joints[1];
            let coulomb_nm = 0.5 * joint.friction.unwrap().phi1_nm;
            for (name, expected) in [
                ("viscous", joint.damping_nm_s_rad),
                ("rotor", joint.armature_kg_m2),
                ("coulomb", coulomb_nm),
            ] {
                let parameter = of_joint(name);
                all += 1;
                inside += i32::from((parameter.value - expected).abs() < 2.0 * parameter.deviation);
            }
        }
        println!("{shares:?}: {inside} of {all} within two deviations");
        assert!(f64::from(inside) > 0.85 * f64::from(all), "{shares:?}: {inside} of {all}");
    }
}

#[test]
fn motions_are_fitted_only_where_no_torque_is_cut_off() {
    let unheard = &mut || ControlFlow::Continue(());
    let settings = Settings { motion_steps: 2, ..Settings::default() };
    let found = identify(&arm(3), &[cut(1, (0.1, 0.1))], &[], &settings, unheard).unwrap();
    let said = "the motions are not fitted: no 1.33 s of the recordings are free of torques";
    let warnings = &found.report.warnings;
    assert!(warnings.iter().any(|warning| warning.starts_with(said)), "{warnings:#?}");
    let less = "Its friction and rotor are less certain than their intervals say";
    assert!(warnings.iter().any(|warning| warning.ends_with(less)), "{warnings:#?}");
    let found = identify(&arm(3), &[cut(1, (0.9, 0.7))], &[], &settings, unheard).unwrap();
    let warnings = &found.report.warnings;
    assert!(warnings.iter().all(|warning| !warning.starts_with(said)), "{warnings:#?}");
    assert!(warnings.iter().all(|warning| !warning.ends_with(less)), "{warnings:#?}");
}
