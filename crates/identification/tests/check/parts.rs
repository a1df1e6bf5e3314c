//! Mistakes in one of several recordings, or in a part of one.

use std::ops::ControlFlow;

use identification::{Recording, Settings, check_log, identify, identify_load};

use super::generated::{Log, arm, drawn};

/// A recording of so many seconds.
fn log(name: &str, seconds: f64) -> Recording {
    let mut log = Log::of(&drawn(&arm(4), 5), 5);
    log.seconds = seconds;
    Recording { name: name.to_owned(), ..log.recording() }
}

/// Turns the torque of joint 2 from a second on.
fn turned(mut recording: Recording, from_s: usize) -> Recording {
    recording.u.iter_mut().skip(125 * from_s).for_each(|row| row[1] *= -1.0);
    recording
}

fn doubts(recordings: &[Recording]) -> Vec<String> {
    check_log(&arm(4), recordings).unwrap().doubts
}

#[test]
fn long_recordings_and_several_without_mistakes_have_no_doubts() {
    assert_eq!(doubts(&[log("long", 400.0)]), [""; 0]);
    let several = ["a", "b", "c", "d", "e"].map(|name| log(name, 16.0));
    assert_eq!(doubts(&several), [""; 0]);
    let check = check_log(&arm(4), &[log("long", 400.0), log("b", 40.0)]).unwrap();
    assert_eq!(check.seconds, 440.0);
}

#[test]
fn a_mistake_that_begins_late_is_told_with_its_time() {
    let found = doubts(&[turned(log("log.csv", 400.0), 267)]);
    let said = "log.csv, 267 to 400 s: u of joint 2 seems to have the other sign";
    assert!(found.iter().any(|doubt| doubt == said), "{found:#?}");
    assert_eq!(found.iter().filter(|doubt| doubt.contains("sign")).count(), 1, "{found:#?}");
}

#[test]
fn a_mistake_in_one_of_several_recordings_is_told_with_its_name() {
    let recordings = [log("a.csv", 40.0), turned(log("b.csv", 40.0), 0), log("c.csv", 40.0)];
    let found = doubts(&recordings);
    let said = "b.csv: u of joint 2 seems to have the other sign";
    assert!(found.iter().any(|doubt| doubt == said), "{found:#?}");
    let everywhere = recordings.map(|recording| {
        let has_it = recording.name == "b.csv";
        if has_it { recording } else { turned(recording, 0) }
    });
    assert_eq!(doubts(&everywhere), ["u of joint 2 seems to have the other sign"]);
}

#[test]
fn a_late_delay_is_told_where_it_is_largest() {
    let late = |name: &str, delay_s: f64| {
        let mut log = Log::of(&drawn(&arm(4), 5), 5);
        log.delay_s = delay_s;
        Recording { name: name.to_owned(), ..log.recording() }
    };
    let recordings = [log("a.csv", 30.0), late("b.csv", 0.02), late("c.csv", 0.04)];
    let found = doubts(&recordings);
    let of_delays: Vec<&String> = found.iter().filter(|it| it.contains("recorded")).collect();
    let [doubt] = of_delays.as_slice() else { panic!("{found:#?}") };
    assert!(doubt.starts_with("c.csv and 1 more part: u of joint"), "{doubt}");
}

#[test]
fn a_limit_is_told_with_the_time_at_which_it_is_passed() {
    let mut recording = log("b.csv", 250.0);
    for row in recording.q.iter_mut().skip(125 * 201).take(125 * 3) {
        row[3] += 1.0;
    }
    let mut described = arm(4);
    let largest = log("a.csv", 30.0).q.iter().map(|row| row[3]).fold(f64::MIN, f64::max);
    described.joints[3].position_rad.max = largest + 0.1;
    let found = check_log(&described, &[log("a.csv", 30.0), recording]).unwrap().doubts;
    let doubt = found.iter().find(|doubt| doubt.starts_with("q goes beyond the limits")).unwrap();
    assert!(doubt.contains("joint 4 reaches ") && doubt.contains(" s into b.csv)"), "{doubt}");
    let time_s: f64 = doubt
        .split(['(', ' '])
        .skip_while(|word| *word != "rad")
        .nth(2)
        .map_or(0.0, |word| word.parse().unwrap());
    assert!((201.0..204.0).contains(&time_s), "{doubt}");
}

#[test]
fn an_identification_compares_every_log_that_it_reads() {
    let settings = Settings { motion_steps: 0, ..Settings::default() };
    let fit = [log("fit.csv", 40.0)];
    let validation = [turned(log("validation.csv", 40.0), 0)];
    let unheard = &mut || ControlFlow::Continue(());
    let found = identify(&arm(4), &fit, &validation, &settings, unheard).unwrap();
    let said = "validation.csv: u of joint 2 seems to have the other sign".to_owned();
    assert!(found.report.warnings.contains(&said), "{:#?}", found.report.warnings);

    let load = |recording: Recording| {
        let unheard = &mut || ControlFlow::Continue(());
        let found = identify_load(&arm(4), &found.arm, &[recording], &[], &settings, unheard);
        found.unwrap().report.warnings
    };
    let said = "u of joint 2 seems to have the other sign".to_owned();
    let with_sign = load(turned(log("load.csv", 40.0), 0));
    assert!(with_sign.contains(&said), "{with_sign:#?}");
    // A load is expected, also one that is heavier than the last link.
    let mut loaded = drawn(&arm(4), 5);
    loaded.joints[3].link.mass_kg += 3.0;
    let right = load(Log::of(&loaded, 5).recording());
    let doubtful = |doubt: &&String| doubt.contains("u of joint") || doubt.contains("explains");
    assert_eq!(right.iter().find(doubtful), None, "{right:#?}");
}
