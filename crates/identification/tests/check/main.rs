//! What is found in logs of arms that are off from their descriptions, after a mistake.
//!
//! A log is made without a simulator: a Fourier motion, and the torques that it needs, at the time
//! that the log says plus its delay.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod cuts;
mod fit;
mod generated;
mod parts;
mod real;

use generated::{Log, arm, drawn};
use identification::{IdentificationError, Recording, check_log};
use spec::RobotDescription;
use wire::LogCheck;

fn checked(description: &RobotDescription, recording: Recording) -> LogCheck {
    let check = check_log(description, &[recording]).unwrap();
    let text = serde_json::to_string(&check).unwrap();
    assert_eq!(serde_json::from_str::<LogCheck>(&text).unwrap(), check, "no number is NaN");
    check
}

/// The check of a log of an arm that is drawn around the description, after a change.
fn after(joints: usize, seed: u64, change: impl Fn(&mut Log)) -> LogCheck {
    let described = arm(joints);
    let mut log = Log::of(&drawn(&described, seed), seed);
    change(&mut log);
    checked(&described, log.recording())
}

#[test]
fn a_log_without_mistakes_has_no_doubts() {
    for joints in [1, 3, 6, 7] {
        for seed in 0..6 {
            let check = after(joints, seed, |_| {});
            assert!(check.doubts.is_empty(), "{joints} {seed}: {:#?}", check.doubts);
            for channel in &check.channels {
                assert!(channel.sign != Some(-1), "{channel:?}");
                assert!(channel.carries_weight != Some(false), "{channel:?}");
                assert!(channel.explained.unwrap() > 0.8, "{channel:?}");
            }
        }
    }
}

#[test]
fn a_delay_is_found_to_a_quarter_of_a_sample() {
    let (mut told, mut all, mut inside) = (0, 0, 0);
    for (seed, samples) in (0..).zip([-3.3, -1.0, 0.25, 0.6, 1.5, 2.75, 7.4, 14.0]) {
        for rate_hz in [60.0, 125.0, 250.0] {
            let delay_s = samples / rate_hz;
            if delay_s > 0.15 {
                continue;
            }
            let check = after(6, seed, |log| {
                log.rate_hz = rate_hz;
                log.delay_s = delay_s;
            });
            for channel in &check.channels {
                all += 1;
                let Some(found) = channel.delay_s else { continue };
                told += 1;
                let error = (found.value - delay_s).abs();
                inside += i32::from(error < 2.0 * found.deviation);
                assert!(
                    error < (0.25 / rate_hz).max(4.0 * found.deviation),
                    "{rate_hz} Hz, {samples} samples: {channel:?}"
                );
            }
            let is_named = check.doubts.iter().any(|doubt| doubt.contains("recorded"));
            if samples.abs() != 1.0 {
                assert_eq!(
                    is_named,
                    samples.abs() > 1.0,
                    "{rate_hz} {samples}: {:?}",
                    check.doubts
                );
            }
        }
    }
    println!("{told} of {all} told, {inside} within two deviations");
    assert!(f64::from(told) > 0.6 * f64::from(all) && f64::from(inside) > 0.85 * f64::from(told));
}

#[test]
fn exchanged_joints_are_named() {
    for (seed, (a, b)) in (0..).zip([(0, 2), (1, 3), (3, 5), (1, 2)]) {
        let both = after(6, seed, |log| {
            log.u_columns.swap(a, b);
            log.q_columns.swap(a, b);
        });
        let expected = format!(
            "joints look exchanged: joint {} fits column {}, joint {} fits column {} of q and u",
            a + 1,
            b + 1,
            b + 1,
            a + 1
        );
        assert_eq!(both.doubts, [expected], "{a} {b}");
        let torques = after(6, seed, |log| log.u_columns.swap(a, b));
        assert!(torques.doubts[0].starts_with("columns of u look exchanged"), "{torques:#?}");
        let positions = after(6, seed, |log| log.q_columns.swap(a, b));
        assert!(positions.doubts[0].starts_with("columns of q look exchanged"), "{positions:#?}");
    }
}

#[test]
fn other_signs_are_named() {
    for joint in 0..6 {
        let seed = joint as u64;
        let torque = after(6, seed, |log| log.u_factors[joint] = -1.0);
        let said = format!("u of joint {} seems to have the other sign", joint + 1);
        assert_eq!(torque.doubts, [said]);
        let position = after(6, seed, |log| log.q_factors[joint] = -1.0);
        let said = format!("q of joint {} seems to have the other sign", joint + 1);
        assert_eq!(position.doubts, [said]);
    }
}

#[test]
fn a_joint_that_turns_the_other_way_is_named() {
    for joint in [1, 3] {
        let check = after(6, joint as u64, |log| {
            log.q_factors[joint] = -1.0;
            log.u_factors[joint] = -1.0;
        });
        let said = format!("joint {} seems to turn the other way", joint + 1);
        assert!(check.doubts.iter().any(|doubt| doubt.starts_with(&said)), "{:?}", check.doubts);
    }
}

#[test]
fn a_sign_that_q_and_u_explain_alike_is_left_open() {
    // A joint about the vertical, alone.
    let check = after(1, 1, |log| log.q_factors[0] = -1.0);
    assert_eq!(
        check.doubts,
        ["u or q of joint 1 seems to have the other sign. The torques do not tell which"]
    );
}

#[test]
fn a_load_is_told_from_gains() {
    let described = arm(6);
    let mut loaded = described.clone();
    loaded.joints[5].link.mass_kg += 6.0;
    let check = checked(&described, Log::of(&loaded, 3).recording());
    let [doubt] = check.doubts.as_slice() else { panic!("{:#?}", check.doubts) };
    assert!(doubt.contains("more so towards the hand: does it carry a load"), "{doubt}");
}

#[test]
fn rows_at_another_rate_are_named() {
    for (declared_hz, factor) in [(62.5, 2.0), (375.0, 1.0 / 3.0)] {
        let mut recording = Log::of(&drawn(&arm(6), 2), 2).recording();
        recording.rate_hz = declared_hz;
        let check = checked(&arm(6), recording);
        let doubt = check.doubts.iter().find(|doubt| doubt.contains("times the rate of the rows"));
        let doubt = doubt.unwrap_or_else(|| panic!("{factor}: {:#?}", check.doubts));
        assert!(doubt.contains("columns.time, units.time and rate_hz"), "{doubt}");
        assert!(!check.doubts.iter().any(|doubt| doubt.contains("columns.gains")), "{doubt}");
    }
}

#[test]
fn torques_that_the_arm_explains_badly_are_named() {
    let described = arm(6);
    let mut recording = Log::of(&drawn(&described, 2), 2).recording();
    recording.q.iter_mut().for_each(|row| row[1] += std::f64::consts::FRAC_PI_2);
    let check = checked(&described, recording);
    assert!(
        check.doubts.iter().any(|doubt| doubt.contains("% of the variance of u of joint 2")),
        "{:#?}",
        check.doubts
    );
}

#[test]
fn units_are_guessed() {
    for (factor, said) in [(1e3, "mN·m"), (1e2, "N·cm"), (0.08, "columns.gains")] {
        let check = after(6, 3, |log| log.u_factors.fill(factor));
        assert_eq!(check.doubts.len(), 1, "{:?}", check.doubts);
        assert!(check.doubts[0].contains(said), "{:?}", check.doubts);
        for scale in check.channels.iter().filter_map(|channel| channel.scale) {
            let ratio = scale.value / factor;
            assert!((0.6..1.6).contains(&ratio), "{factor}: {scale:?}");
        }
    }
}

#[test]
fn positions_in_the_place_of_torques_are_named() {
    for (per_rad, ahead) in [(1.0, 0), (1.0_f64.to_degrees(), 3)] {
        let mut recording = Log::of(&drawn(&arm(3), 2), 2).recording();
        let commanded = recording.q.clone();
        for (sample, row) in recording.u.iter_mut().enumerate() {
            let of = commanded.get(sample + ahead).unwrap_or(&commanded[sample]);
            *row = of.iter().map(|q| q * per_rad).collect();
        }
        let all = checked(&arm(3), recording.clone());
        let said = "u of joints 1, 2 and 3 follows their positions: these are positions (LeRobot's `action` is the \
                    commanded position), not torques";
        assert_eq!(all.doubts, [said], "{per_rad}");
        let torques = Log::of(&drawn(&arm(3), 2), 2).recording().u;
        for (row, torques) in recording.u.iter_mut().zip(torques) {
            (row[0], row[2]) = (torques[0], torques[2]);
        }
        let one = checked(&arm(3), recording);
        assert_eq!(one.doubts.len(), 1, "{:#?}", one.doubts);
        assert!(
            one.doubts[0].starts_with("u of joint 2 follows its position: "),
            "{:?}",
            one.doubts
        );
    }
}

#[test]
fn compensated_gravity_is_seen() {
    for seed in 0..6 {
        let check = after(6, seed, |log| log.gravity = 0.0);
        assert!(check.doubts.is_empty(), "{:?}", check.doubts);
        let told: Vec<_> =
            check.channels.iter().filter_map(|channel| channel.carries_weight).collect();
        assert!(told.len() >= 2 && !told.contains(&true), "{seed}: {:#?}", check.channels);
        let check = after(6, seed, |_| {});
        let told: Vec<_> =
            check.channels.iter().filter_map(|channel| channel.carries_weight).collect();
        assert!(told.len() >= 2 && !told.contains(&false), "{seed}: {:#?}", check.channels);
    }
}

#[test]
fn a_joint_that_hardly_moves_says_nothing() {
    let check = after(3, 1, |log| log.amplitudes[1] = 0.0);
    let still = &check.channels[1];
    assert_eq!((still.delay_s, still.scale, still.sign), (None, None, None));
    assert!(still.unseen.as_ref().unwrap().contains("moves by"), "{still:?}");
    assert!(check.doubts.is_empty(), "{:?}", check.doubts);
}

#[test]
fn a_motion_too_slow_for_accelerations_tells_no_delay() {
    let check = after(6, 2, |log| log.base_hz = 0.01);
    for channel in &check.channels {
        assert!(channel.delay_s.is_none_or(|delay| delay.value.abs() < 4.0 * delay.deviation));
        assert!(channel.carries_weight != Some(false), "{channel:?}");
    }
    assert!(check.doubts.is_empty(), "{:?}", check.doubts);
}

#[test]
fn noise_instead_of_torques_is_told_apart() {
    let check = after(6, 2, |log| log.u_factors.fill(0.0));
    for channel in &check.channels {
        assert_eq!((channel.scale, channel.sign, channel.carries_weight), (None, None, None));
        assert_eq!(channel.delay_s, None);
    }
    assert!(
        check.doubts.iter().all(|doubt| doubt.contains("the arm explains")),
        "{:?}",
        check.doubts
    );
}

#[test]
fn motions_and_torques_beyond_the_limits_are_named() {
    let log = Log::of(&drawn(&arm(6), 2), 2).recording();
    let largest = |rows: &[Vec<f64>], joint: usize| {
        rows.iter().map(|row| row[joint]).fold(f64::NEG_INFINITY, f64::max)
    };
    let (q, u) = (largest(&log.q, 2), log.u.iter().map(|row| row[1].abs()).fold(0.0, f64::max));
    let mut narrow = arm(6);
    narrow.joints[2].position_rad.max = q - 0.04;
    narrow.joints[1].torque_nm = u / 1.05;
    assert_eq!(checked(&narrow, log.clone()).doubts, [""; 0], "within what zero positions are off");

    narrow.joints[2].position_rad.max = q - 0.2;
    narrow.joints[3].position_rad.min = 0.5;
    narrow.joints[4].velocity_rad_s = 0.01;
    narrow.joints[1].torque_nm = u / 1.5;
    let doubts = checked(&narrow, log.clone()).doubts;
    let [position, speed, torque] = doubts.as_slice() else { panic!("{doubts:#?}") };
    assert!(position.starts_with("q goes beyond the limits of the robot: joint 3 "), "{position}");
    assert!(
        position.contains(", joint 4 reaches -")
            && position.contains(" of 0.5 rad (")
            && position.contains(" s into 2). Are"),
        "{position}"
    );
    assert!(speed.contains(" the limits of the robot: joint 5 reaches "), "{speed}");
    assert!(speed.contains(" of 0.01 rad/s ("), "{speed}");
    assert!(torque.starts_with("u goes beyond the limits of the robot: joint 2 "), "{torque}");

    // Noise makes no speed.
    let mut noisy = log;
    for (sample, row) in noisy.q.iter_mut().enumerate() {
        row[0] += if sample % 2 == 0 { 2e-3 } else { -2e-3 };
    }
    assert_eq!(checked(&arm(6), noisy).doubts, [""; 0]);
}

#[test]
fn a_log_that_is_short_or_constant_says_so() {
    let short = after(3, 1, |log| log.seconds = 1.0);
    assert!((short.seconds, &short.doubts) == (0.0, &Vec::new()));
    assert!(short.channels.iter().all(|channel| channel.unseen.is_some()));
    let described = arm(3);
    let mut recording = Log::of(&described, 1).recording();
    recording.u.iter_mut().for_each(|row| row[2] = 0.0);
    let constant = checked(&described, recording.clone());
    assert_eq!(constant.doubts, ["u of joint 3 is constant"]);
    assert_eq!(check_log(&described, &[]).unwrap().seconds, 0.0);
    recording.q[5][1] = f64::NAN;
    let refused = check_log(&described, &[recording]).unwrap_err();
    assert!(matches!(refused, IdentificationError::NotFinite { .. }));
}
