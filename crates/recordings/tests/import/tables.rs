//! The contents of a dataset's tables after an import.

use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Float64Type, Int32Type, Int64Type};
use serde_json::json;
use wire::ImportCounts;

use super::{Imported, Recordings, channel_names, check_refused, import, spec};

#[test]
fn trajectories_say_where_they_come_from() {
    let recordings = Recordings::of(&[50, 30, 90]);
    let spec = spec("csv", &json!({"split": {"kind": "windows", "stride": 40}}));
    let Imported { samples, table, counts, .. } = import(recordings.csv(), &spec).unwrap();
    let expected = ImportCounts {
        rows: 170,
        recordings: 3,
        dropped_recordings: 1,
        trajectories: 3,
        dropped_samples: 10 + 30 + 10,
        ..ImportCounts::default()
    };
    assert_eq!(counts, expected);

    assert_eq!(table.column(0).as_primitive::<Int32Type>().values(), &[0, 1, 2]);
    let names: Vec<_> = table.column(1).as_string::<i32>().iter().flatten().collect();
    assert_eq!(names, ["arm 0", "arm 2", "arm 2"]);
    let times = table.column(2).as_primitive::<Float64Type>().values().to_vec();
    assert_eq!(times, [0.0, 0.0, 40.0 / 60.0]);
    assert_eq!(table.column(3).as_primitive::<Int64Type>().values(), &[0, 80, 120]);

    assert_eq!(samples.num_rows(), 120);
    let trajectory = samples.column(0).as_primitive::<Int32Type>();
    let step = samples.column(1).as_primitive::<Int32Type>();
    assert_eq!((trajectory.value(79), step.value(79)), (1, 39));
    let q3 = samples.column_by_name("q3").unwrap().as_primitive::<Float32Type>();
    assert_eq!(f64::from(q3.value(85)), recordings.channels[9][125]);
}

#[test]
fn degrees_and_milliseconds_become_radians_and_seconds() {
    let mut recordings = Recordings::of(&[40]);
    let radians = recordings.channels[7].clone();
    recordings.channels[7..].iter_mut().flatten().for_each(|q| *q = q.to_degrees());
    recordings.times.iter_mut().for_each(|time| *time = 5.0 + *time * 1000.0);
    let units = json!({"units": {"angle": "deg", "time": "ms"}});
    let Imported { samples, table, .. } = import(recordings.csv(), &spec("csv", &units)).unwrap();
    let q1 = samples.column_by_name("q1").unwrap().as_primitive::<Float32Type>().clone();
    for (value, expected) in q1.values().iter().zip(radians) {
        assert!((f64::from(*value) - expected).abs() < 1e-6);
    }
    assert_eq!(table.column(2).as_primitive::<Float64Type>().value(0), 0.005);

    check_refused(
        recordings.csv(),
        &spec("csv", &json!({"units": {"time": "ms"}})),
        &["recording \"arm 0\", line 2, column \"pos_1\"", "ranges.q_rad", "degrees"],
    );
    let degrees = spec("csv", &json!({"units": {"angle": "deg"}}));
    check_refused(recordings.csv(), &degrees, &["line 3", "\"t\"", "units.time ms"]);
}

#[test]
fn velocities_become_columns_when_they_are_mapped() {
    let recordings = Recordings::of(&[40]);
    let names = channel_names();
    let mut columns = json!({"time": "t", "u": names[..7], "q": names[7..]});
    columns["qd"] = json!(["v1", "v2", "v3", "v4", "v5", "v6", "v7"]);
    let header = recordings.csv().replacen('\n', ",v1,v2,v3,v4,v5,v6,v7\n", 1);
    let (header, rows) = header.split_once('\n').unwrap();
    let rows: Vec<String> = rows.lines().map(|row| format!("{row},1,2,3,4,5,6,7\n")).collect();
    let file = format!("{header}\n{}", rows.concat());
    let mapping = spec("csv", &json!({"columns": columns}));
    let samples = import(file.clone(), &mapping).unwrap().samples;
    assert_eq!(samples.num_columns(), 2 + 21);
    let qd7 = samples.column_by_name("qd7").unwrap().as_primitive::<Float32Type>();
    assert_eq!(qd7.value(39), 7.0);

    // They have limits as positions have, once the robot is known.
    let robot = json!({"columns": columns, "robot": {}, "ranges": {"q_rad": [-1, 1]}});
    check_refused(
        file,
        &spec("csv", &robot),
        &["column \"v3\": 3 rad/s, allowed: -2.175 to 2.175 rad/s (velocity_rad_s of joint 3 in \
             robot.model; ranges.qd_rad_s replaces it)"],
    );
}

#[test]
fn without_time_rows_are_a_period_apart_and_without_names_one_recording() {
    let recordings = Recordings::of(&[30, 30]);
    let names = channel_names();
    let columns = json!({"u": names[..7], "q": names[7..]});
    let split = json!({"kind": "windows", "stride": 20});
    // The second one begins elsewhere.
    let ranges = json!({"qd_rad_s": [-100, 100]});
    let spec = spec("csv", &json!({"columns": columns, "split": split, "ranges": ranges}));
    let Imported { table, counts, .. } = import(recordings.csv(), &spec).unwrap();
    assert_eq!((counts.recordings, counts.trajectories, counts.dropped_samples), (1, 2, 0));
    assert_eq!(table.column(1).as_string::<i32>().value(1), "");
    assert_eq!(table.column(2).as_primitive::<Float64Type>().value(1), 20.0 / 60.0);
}

#[test]
fn a_recording_that_is_not_as_long_as_the_others_is_refused_whole() {
    let recordings = Recordings::of(&[40, 41]);
    check_refused(
        recordings.csv(),
        &spec("csv", &json!({})),
        &[
            "recording \"arm 1\", line 42: the recording that begins here has 41 samples, allowed: samples = 40; \
             \"samples\": 41 takes it whole; \"split\": {\"kind\": \"windows\", \"stride\": 40} cuts it into 1 window",
        ],
    );
}

#[test]
fn a_recording_too_long_for_a_trajectory_is_cut_by_the_field_that_its_error_names() {
    let long = Recordings::of(&[10_041]);
    let error = import(long.csv(), &spec("csv", &json!({}))).err().unwrap();
    let split = "{\"kind\": \"windows\", \"stride\": 40}";
    let allowed = format!("allowed: samples = 40; \"split\": {split} cuts it into 251 windows");
    assert!(error.contains(&allowed), "{error}");
    let split: serde_json::Value = serde_json::from_str(split).unwrap();
    let cut = import(long.csv(), &spec("csv", &json!({"split": split}))).unwrap();
    assert_eq!((cut.counts.trajectories, cut.counts.dropped_samples), (251, 1));
}

#[test]
fn a_file_without_a_trajectory_is_refused_with_what_it_has() {
    let recordings = Recordings::of(&[30, 20]);
    let spec = spec("csv", &json!({"split": {"kind": "windows", "stride": 1}}));
    check_refused(recordings.csv(), &spec, &["50 rows", "2 recordings", "needs 40"]);
    check_refused(recordings.csv(), &spec, &["; \"samples\": 30 takes the longest recording"]);
}

/// Milliseconds that are declared as microseconds give recordings of few samples.
#[test]
fn a_rate_that_no_robot_records_suggests_another_unit_of_time() {
    let mut recordings = Recordings::of(&[4001]);
    recordings.times = (0..4001).map(|row| f64::from(row) * 2.0).collect();
    let fields = |more: serde_json::Value| {
        let mut fields = json!({
            "units": {"time": "us"}, "resampling": "linear", "rate_hz": 500,
            "ranges": {"qd_rad_s": [-1e6, 1e6]},
        });
        fields.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        spec("csv", &fields)
    };
    let likely = "with units.time \"ms\" rows are 0.002 s apart";
    check_refused(recordings.csv(), &fields(json!({})), &["allowed: samples = 40", likely]);
    let windows = json!({"split": {"kind": "windows", "stride": 40}});
    check_refused(recordings.csv(), &fields(windows), &["it gives no trajectory", likely]);
    let slow = fields(json!({"rate_hz": 100}));
    check_refused(recordings.csv(), &slow, &["500000 Hz, allowed: at most 1024", likely]);
    let imported = import(recordings.csv(), &fields(json!({"samples": 5}))).unwrap();
    let [warning] = imported.counts.warnings.as_slice() else { panic!("{:?}", imported.counts) };
    assert!(
        warning.starts_with("recording \"arm 0\" is faster than any robot records"),
        "{warning}"
    );
    assert!(warning.ends_with(likely), "{warning}");
}

#[test]
fn recordings_have_a_length_and_a_rate() {
    let csv = spec("csv", &json!({"resampling": "linear", "rate_hz": 30}));
    let windows =
        spec::ImportSpec { split: spec::Split::Windows { stride: 10 }, samples: 10, ..csv };
    let file = Recordings::of(&[61, 31]).csv();
    let lengths = super::decoder::reused(&file.into_bytes(), &windows, |rows| {
        let mut conversion = super::conversion(rows, &windows);
        while conversion.next_trajectories()?.is_some() {}
        Ok(conversion.lengths().clone())
    });
    let lengths = lengths.unwrap();
    assert_eq!((lengths.fewest_samples, lengths.most_samples), (16, 31));
    let [first, second] = lengths.recordings.as_slice() else { panic!("{lengths:?}") };
    assert_eq!((first.name.as_str(), first.rows, first.samples), ("arm 0", 61, 31));
    assert!((first.seconds - 1.0).abs() < 1e-9, "{first:?}");
    assert!((second.median_rate_hz.unwrap() - 60.0).abs() < 1e-6, "{second:?}");
}

/// A hundred overlapping windows of a short file, handed on in parts.
#[test]
fn memory_does_not_grow_with_what_comes_out() {
    let recordings = Recordings::of(&[1100]);
    let fields = json!({"split": {"kind": "windows", "stride": 1}, "samples": 1000});
    let imported = import(recordings.csv(), &spec("csv", &fields)).unwrap();
    assert_eq!((imported.counts.trajectories, imported.samples.num_rows()), (101, 101_000));
    assert!(imported.parts.iter().all(|rows| *rows < 52_000), "{:?}", imported.parts);
}
