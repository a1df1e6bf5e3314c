//! Positions that no joint can have one after the other, and possible ones that look like them.

use std::f64::consts::{PI, TAU};

use arrow_array::cast::AsArray;
use arrow_array::types::Float32Type;
use random::{ChaCha8Rng, Rng, SeedableRng};
use serde_json::{Value, json};
use spec::ImportSpec;

use super::{Recordings, check_refused, import, small_pages, spec};

/// The channel of `pos_3`.
const POS_3: usize = 9;

/// A recording at `rate_hz` whose third joint has the position that a function of time gives. The
/// others move slowly, away from 0.
fn moving(rate_hz: f64, rows: usize, position: impl Fn(f64) -> f64) -> Recordings {
    let times: Vec<f64> = (0..rows).map(|k| k as f64 / rate_hz).collect();
    let slow = |channel: usize| move |time: &f64| 0.6 + 0.3 * (time + channel as f64).sin();
    let mut channels: Vec<Vec<f64>> =
        (0..14).map(|channel| times.iter().map(slow(channel)).collect()).collect();
    channels[POS_3] = times.iter().map(|time| position(*time)).collect();
    Recordings { names: vec!["arm 0".to_owned(); rows], times, channels }
}

/// A mapping that takes recordings of any length.
fn mapping(rate_hz: f64, fields: &Value) -> ImportSpec {
    let mut all = json!({"rate_hz": rate_hz, "split": {"kind": "windows", "stride": 40}});
    all.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    spec("csv", &all)
}

/// A slow motion with some of its rows changed.
fn disturbed(change: impl Fn(usize, f64) -> f64) -> Recordings {
    let mut recordings = moving(60.0, 200, |time| 1.0 + time.sin());
    for (row, position) in recordings.channels[POS_3].iter_mut().enumerate() {
        *position = change(row, *position);
    }
    recordings
}

#[track_caller]
fn check_imported(recordings: &Recordings, spec: &ImportSpec) {
    let imported = import(recordings.csv(), spec).unwrap();
    assert!(imported.counts.warnings.is_empty(), "{:?}", imported.counts.warnings);
}

fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

/// The third joint of the result.
fn third_joint(file: String, spec: &ImportSpec) -> Vec<f64> {
    let imported = import(file, spec).unwrap();
    let column = imported.samples.column_by_name("q3").unwrap();
    column.as_primitive::<Float32Type>().values().iter().map(|q| f64::from(*q)).collect()
}

#[test]
fn an_angle_that_wraps_is_refused_with_both_values_and_what_to_do() {
    let recordings = moving(125.0, 200, |time| wrapped(2.5 + 1.5 * time));
    let expected = [
        "recording \"arm 0\", line 56, column \"pos_3\": -3.13",
        "rad, and 3.13",
        "rad in line 55, 0.008 s before, which is -78",
        "allowed: 20 rad/s between two rows (ranges.qd_rad_s)",
        "\"unwrap\": true",
    ];
    for resampling in ["none", "linear"] {
        let rate_hz = if resampling == "none" { 125.0 } else { 60.0 };
        let spec = mapping(rate_hz, &json!({"resampling": resampling}));
        check_refused(recordings.csv(), &spec, &expected);
    }
    let parquet =
        spec("parquet", &json!({"rate_hz": 125.0, "split": {"kind": "windows", "stride": 40}}));
    check_refused(
        recordings.parquet(small_pages()),
        &parquet,
        &["row 55 (counted from 1)", "in row 54"],
    );
    let limit = mapping(125.0, &json!({"robot": {}, "ranges": {"q_rad": [-4, 4]}}));
    let source = "2.175 rad/s between two rows (velocity_rad_s of joint 3 in robot.model; \
                  ranges.qd_rad_s replaces it)";
    check_refused(recordings.csv(), &limit, &[source, "unwrap"]);
}

/// Between 3.12 and -3.12 rad, `linear` would otherwise invent positions near 0.
#[test]
fn a_wrapped_angle_becomes_continuous_on_request() {
    let motion = |time: f64| 2.5 + 1.5 * time;
    for in_degrees in [false, true] {
        let mut recordings = moving(125.0, 300, |time| wrapped(motion(time)));
        let mut fields = json!({"resampling": "linear", "unwrap": true});
        if in_degrees {
            recordings.channels[7..].iter_mut().flatten().for_each(|q| *q = q.to_degrees());
            fields["units"] = json!({"angle": "deg"});
        }
        let positions = third_joint(recordings.csv(), &mapping(60.0, &fields));
        assert_eq!(positions.len(), 120);
        for (row, position) in positions.iter().enumerate() {
            assert!((position - motion(row as f64 / 60.0)).abs() < 1e-5, "{row}: {position}");
        }
    }
}

/// Ranges and jumps are checked with the turns.
#[test]
fn an_unwrapped_angle_is_within_its_limits_and_does_not_jump() {
    let unwrap = mapping(60.0, &json!({"unwrap": true}));
    let far = moving(60.0, 300, |time| wrapped(2.5 + 1.5 * time));
    check_refused(far.csv(), &unwrap, &["column \"pos_3\": 6.5", "-6.5 to 6.5 rad"]);
    let lost = disturbed(|row, q| if row == 70 { 0.0 } else { q });
    check_refused(lost.csv(), &unwrap, &["line 72, column \"pos_3\"", "spike"]);
    let two = Recordings::of(&[40, 40]);
    let (with, without) = (json!({"unwrap": true}), json!({}));
    let [with, without] = [with, without].map(|fields| import(two.csv(), &spec("csv", &fields)));
    assert_eq!(with.unwrap().samples, without.unwrap().samples);
}

#[test]
fn a_row_of_zeros_is_refused_wherever_it_is() {
    for row in [0, 1, 2, 77, 150, 198, 199] {
        let mut recordings = disturbed(|_, q| q);
        recordings.channels.iter_mut().for_each(|channel| channel[row] = 0.0);
        let zeros = format!("all positions of line {} are 0", row + 2);
        let spec = mapping(60.0, &json!({}));
        check_refused(recordings.csv(), &spec, &[&zeros, "leave it out"]);
    }
}

#[test]
fn a_spike_and_a_lasting_jump_are_refused() {
    let spec = mapping(60.0, &json!({}));
    let spike = disturbed(|row, q| if row == 90 { q + 0.8 } else { q });
    check_refused(spike.csv(), &spec, &["line 92, column \"pos_3\"", "line 93 has", "spike"]);
    let lasting = disturbed(|row, q| if row >= 90 { q + 0.8 } else { q });
    check_refused(
        lasting.csv(),
        &spec,
        &["line 92, column \"pos_3\"", "units.time", "another recording"],
    );
    let ends = disturbed(|row, q| if row == 199 { q + 0.8 } else { q });
    check_refused(ends.csv(), &spec, &["line 201, column \"pos_3\""]);
    // Every other row was lost.
    let holes = disturbed(|row, q| if row >= 90 && row % 2 == 0 { q - 1.5 } else { q });
    check_refused(holes.csv(), &spec, &["line 92, column \"pos_3\""]);
    // Somebody has interpolated across the wrap.
    let motion = |time: f64| wrapped(2.5 + 1.5 * time);
    let mut smooth = moving(60.0, 200, motion);
    smooth.channels[POS_3][26] = 0.0;
    check_refused(smooth.csv(), &spec, &["line 28, column \"pos_3\""]);
}

/// Jumps are found some rows later than other faults.
#[test]
fn the_first_wrong_row_is_reported() {
    let spec = mapping(60.0, &json!({}));
    let mut spike = disturbed(|row, q| if row == 90 { q + 0.8 } else { q });
    spike.channels[0][100] = 1e6;
    check_refused(spike.csv(), &spec, &["line 92, column \"pos_3\""]);
    spike.channels[0][80] = 1e6;
    check_refused(spike.csv(), &spec, &["line 82, column \"tau_1\""]);
}

#[test]
fn another_recording_may_begin_anywhere() {
    let mut recordings = disturbed(|row, q| if row >= 90 { q - 2.5 } else { q });
    recordings.names[90..].fill("arm 1".to_owned());
    check_imported(&recordings, &mapping(60.0, &json!({})));
}

/// A motion of 20 rad/s is within the default limit. Faster ones go on from row to row.
#[test]
fn a_fast_motion_is_no_jump() {
    let turning = |speed: f64| move |time: f64| 3.0 * (speed / 3.0 * time).sin();
    for (rate_hz, speed) in
        [(60.0, 19.9), (250.0, 20.0), (1000.0, 20.0), (250.0, 60.0), (100.0, 40.0)]
    {
        check_imported(&moving(rate_hz, 500, turning(speed)), &mapping(rate_hz, &json!({})));
    }
    // Above the limit of a Panda, as simulations are, and up to a hard stop at it.
    let panda = |fields: &Value| {
        let mut all = json!({"robot": {}, "ranges": {"q_rad": [-4, 4]}});
        all.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        all
    };
    for (rate_hz, speed) in [(60.0, 6.0), (1000.0, 8.0)] {
        check_imported(
            &moving(rate_hz, 500, turning(speed)),
            &mapping(rate_hz, &panda(&json!({}))),
        );
    }
    let stopped = moving(100.0, 300, |time| (2.175 * time).min(2.9));
    check_imported(&stopped, &mapping(100.0, &panda(&json!({}))));
    // No time column: the times come from the rate.
    let mut untimed = mapping(60.0, &json!({}));
    untimed.columns.time = None;
    check_imported(&moving(60.0, 200, turning(15.0)), &untimed);
}

#[test]
fn an_encoder_with_noise_or_coarse_steps_does_not_jump() {
    let panda = json!({"robot": {}, "ranges": {"q_rad": [-4, 4]}});
    let mut random = ChaCha8Rng::seed_from_u64(7);
    // The sum of twelve uniform numbers is nearly normal.
    let mut normal =
        || (0..12).map(|_| f64::from(random.next_u32()) / f64::from(u32::MAX)).sum::<f64>() - 6.0;
    for deviation in [0.001, 0.01, 0.03] {
        let mut noisy = moving(1000.0, 5000, |time| time.sin());
        noisy.channels[POS_3].iter_mut().for_each(|q| *q += deviation * normal());
        check_imported(&noisy, &mapping(1000.0, &panda));
    }
    for quantum in [0.006, 1f64.to_radians(), 0.04] {
        let mut coarse = moving(1000.0, 3000, |time| (2.0 * time).sin());
        coarse.channels[POS_3].iter_mut().for_each(|q| *q = (*q / quantum).round() * quantum);
        check_imported(&coarse, &mapping(1000.0, &panda));
    }
    let mut stated = panda;
    stated["position_noise_rad"] = json!(0.1);
    let mut noisy = moving(60.0, 40, |time| time.sin());
    for (row, q) in noisy.channels[POS_3].iter_mut().enumerate() {
        *q += if row % 7 == 3 { 0.4 } else { 0.0 };
    }
    check_imported(&noisy, &mapping(60.0, &stated));
}

/// A position is measured ten times a second and logged a hundred times.
#[test]
fn a_position_that_is_held_between_measurements_does_not_jump() {
    let staircase = |time: f64| ((time * 10.0 + 1e-6).floor() / 5.0).sin();
    check_imported(
        &moving(100.0, 500, staircase),
        &mapping(100.0, &json!({"robot": {}, "ranges": {"q_rad": [-4, 4]}})),
    );
}

/// The times are those of a program that waited, and then read everything at once.
#[test]
fn late_and_crowded_times_make_no_jump() {
    let mut recordings = moving(100.0, 500, |time| 3.0 * (5.0 * time).sin());
    for (row, time) in recordings.times.iter_mut().enumerate() {
        let late = 9 - row % 10;
        *time += late as f64 * 0.009_99;
    }
    check_imported(&recordings, &mapping(60.0, &json!({"resampling": "linear"})));
    // A long pause bridges any way.
    let mut paused = disturbed(|row, q| if row >= 90 { q - 1.8 } else { q });
    paused.times[90..].iter_mut().for_each(|time| *time += 0.9);
    let fields =
        json!({"robot": {}, "ranges": {"q_rad": [-4, 4]}, "resampling": "linear", "max_gap_s": 1});
    check_imported(&paused, &mapping(60.0, &fields));
}

#[test]
fn wider_ranges_allow_every_step() {
    let spike = disturbed(|row, q| if row == 90 { q + 0.8 } else { q });
    check_imported(&spike, &mapping(60.0, &json!({"ranges": {"qd_rad_s": [-100, 100]}})));
}

/// The recording with velocities `v1` to `v7`, all 0 except the third.
fn with_velocities(recordings: &Recordings, velocity: f64) -> (String, Value) {
    let header = recordings.csv().replacen('\n', ",v1,v2,v3,v4,v5,v6,v7\n", 1);
    let (header, rows) = header.split_once('\n').unwrap();
    let rows: String = rows.lines().map(|row| format!("{row},0,0,{velocity},0,0,0,0\n")).collect();
    let names = super::channel_names();
    let qd: Vec<String> = (1..=7).map(|joint| format!("v{joint}")).collect();
    let columns =
        json!({"time": "t", "recording": "arm", "u": names[..7], "q": names[7..], "qd": qd});
    (format!("{header}\n{rows}"), json!({"columns": columns}))
}

#[test]
fn a_position_that_stays_while_its_velocity_goes_on_is_refused() {
    let frozen = moving(60.0, 300, |time| 0.5 * time.min(2.0));
    let (file, fields) = with_velocities(&frozen, 0.5);
    check_refused(
        file,
        &mapping(60.0, &fields),
        &[
            "column \"pos_3\": 1 rad since line 122",
            "column \"v3\" says that the joint moved by 0.2",
            "froze",
        ],
    );
    // It stands, or the velocity is a little off.
    for velocity in [0.0, 0.09] {
        let (file, fields) = with_velocities(&frozen, velocity);
        let counts = import(file, &mapping(60.0, &fields)).unwrap().counts;
        assert!(counts.warnings.is_empty(), "{:?}", counts.warnings);
    }
}

/// A brake or a controller may hold the joint, so the recording is imported.
#[test]
fn a_position_that_stays_while_its_torque_changes_is_doubtful() {
    let mut frozen =
        moving(60.0, 600, |time| if time < 3.0 { time } else { 3.0 + (time - 8.0).max(0.0) });
    check_imported(&frozen, &mapping(60.0, &json!({})));
    for (row, torque) in frozen.channels[2].iter_mut().enumerate() {
        *torque = 20.0 * (row as f64 * 0.05).sin();
    }
    let counts = import(frozen.csv(), &mapping(60.0, &json!({}))).unwrap().counts;
    let [warning] = counts.warnings.as_slice() else { panic!("{:?}", counts.warnings) };
    for part in [
        "recording \"arm 0\", line 182 to line 482",
        "\"pos_3\" stays at 3 rad for 5 s",
        "\"tau_3\" changes",
    ] {
        assert!(warning.contains(part), "{warning}");
    }
}
