//! Recordings of real arms, which are not part of the repository.

use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};

use identification::{Recording, Settings, check_log, identify, identify_load};
use spec::{RobotDescription, RobotModel};

/// The folder of recordings, if it lies beside the repository.
fn folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/reference/real");
    if !folder.exists() {
        println!("skipped: there are no recordings of real arms beside the repository");
        return None;
    }
    Some(folder)
}

/// A log at even times. Rows that repeat a time and a last one that is cut are left out.
fn read(path: &Path, rate_hz: f64, q: Range<usize>, u: Range<usize>, gains: &[f64]) -> Recording {
    let text = std::fs::read_to_string(path).unwrap();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for line in text.lines() {
        let row: Vec<f64> = line.split(',').map_while(|value| value.parse().ok()).collect();
        if row.len() >= u.end && rows.last().is_none_or(|last| row[0] > last[0]) {
            rows.push(row);
        }
    }
    let name = path.display().to_string();
    let mut recording = Recording { name, rate_hz, q: Vec::new(), u: Vec::new() };
    let mut at = 0;
    let times = (0_u32..).map(|sample| rows[0][0] + f64::from(sample) / rate_hz);
    for time in times.take_while(|time| *time < rows[rows.len() - 1][0]) {
        while rows[at + 1][0] <= time {
            at += 1;
        }
        let (before, after) = (&rows[at], &rows[at + 1]);
        let share = (time - before[0]) / (after[0] - before[0]);
        let value = |column: usize| before[column] + share * (after[column] - before[column]);
        recording.q.push(q.clone().map(value).collect());
        recording.u.push(u.clone().map(value).zip(gains).map(|(u, gain)| u * gain).collect());
    }
    recording
}

/// There are no doubts, nor after a fit to torques, and after an exchange of joints 2 and 4 there are.
fn check(description: &RobotDescription, recording: Recording) {
    let found = check_log(description, std::slice::from_ref(&recording)).unwrap();
    for channel in &found.channels {
        println!("{channel:?}");
    }
    assert!(found.doubts.is_empty(), "{:#?}", found.doubts);
    for channel in &found.channels {
        assert!(channel.sign != Some(-1) && channel.carries_weight != Some(false), "{channel:?}");
    }
    let settings = Settings { motion_steps: 0, ..Settings::default() };
    let recordings = std::slice::from_ref(&recording);
    let unheard = &mut || ControlFlow::Continue(());
    let fitted = identify(description, recordings, &[], &settings, unheard).unwrap();
    let warnings = fitted.report.warnings;
    assert!(warnings.iter().all(|warning| warning.contains("hardly seen")), "{warnings:#?}");
    let mut exchanged = recording;
    for row in exchanged.q.iter_mut().chain(&mut exchanged.u) {
        row.swap(1, 3);
    }
    let doubts = check_log(description, &[exchanged]).unwrap().doubts;
    assert!(doubts[0].contains("joint 2 fits column 4, joint 4 fits column 2"), "{doubts:?}");
}

#[test]
fn a_real_panda_raises_no_doubts_and_its_mistakes_do() {
    let Some(folder) = folder() else { return };
    let path = folder.join("panda_exciting.csv");
    let model = RobotModel::panda();
    check(model.description(), read(&path, 250.0, 1..8, 15..22, &[1.0; 7]));
}

#[test]
fn a_real_ur10e_raises_no_doubts_and_its_mistakes_do() {
    let Some(folder) = folder() else { return };
    let folder = folder.join("ur10e");
    let text = std::fs::read_to_string(folder.join("ur10e.urdf")).unwrap();
    let arm = urdf::read(&text, &urdf::Options::default()).unwrap();
    let gains = [14.87, 13.26, 11.13, 10.62, 11.03, 11.47];
    for log in ["ur-20_02_12-40sec_12harm", "ur-20_02_12-50sec_12harm", "ur-20_02_19_14harm50sec"] {
        let path = folder.join(log).with_extension("csv");
        check(&arm.description, read(&path, 125.0, 1..7, 13..19, &gains));
        let amperes = read(&path, 125.0, 1..7, 13..19, &[1.0; 6]);
        let doubts = check_log(&arm.description, &[amperes]).unwrap().doubts;
        assert!(doubts.iter().any(|doubt| doubt.contains("columns.gains")), "{doubts:?}");
    }
}

#[test]
fn real_logs_and_one_with_a_load_raise_no_doubts_together() {
    let Some(folder) = folder() else { return };
    let folder = folder.join("ur10e");
    let text = std::fs::read_to_string(folder.join("ur10e.urdf")).unwrap();
    let described = urdf::read(&text, &urdf::Options::default()).unwrap().description;
    let gains = [14.87, 13.26, 11.13, 10.62, 11.03, 11.47];
    let log =
        |name: &str| read(&folder.join(name).with_extension("csv"), 125.0, 1..7, 13..19, &gains);
    let fit = ["ur-20_02_12-40sec_12harm", "ur-20_02_12-50sec_12harm"].map(log);
    let validation = [log("ur-20_02_19_14harm50sec")];
    let settings = Settings { motion_steps: 0, gain_deviation: 0.15, ..Settings::default() };
    let unheard = &mut || ControlFlow::Continue(());
    let found = identify(&described, &fit, &validation, &settings, unheard).unwrap();
    let loaded = [log("ur-20_02_19_14harm50secLoad")];
    let load = identify_load(&described, &found.arm, &loaded, &[], &settings, unheard).unwrap();
    for warning in found.report.warnings.iter().chain(&load.report.warnings) {
        assert!(warning.contains("hardly seen"), "{warning}");
    }
}
