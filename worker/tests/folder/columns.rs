use arrow_array::Array;
use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Float64Type, Int32Type, Int64Type};
use serde_json::json;
use spec::{Column, ColumnType};
use store::TableReader;

use super::fixture::{description, make, rows, spec_with, verify};

/// A simulation that records and draws everything possible.
fn rich() -> spec::SimulateSpec {
    spec_with(&json!({
        "seed": 12,
        "observations": {
            "joint_velocities": true, "end_effector_pose": true,
            "position_noise_rad": 1e-3, "torque_noise_nm": 0.2,
        },
        "robot": {
            "gravity": "compensated",
            "geometry_fraction": 0.05,
            "friction": {},
            "payload": {"mass_kg": [0.5, 2.0]},
        },
    }))
}

/// Arms with six joints, given by a description.
fn arms_of_six() -> spec::SimulateSpec {
    let model: serde_json::Value =
        serde_json::from_str(include_str!("../../../tests/data/arm_of_six.json")).unwrap();
    spec_with(&json!({
        "seed": 13,
        "observations": {"joint_velocities": true, "end_effector_pose": true},
        "robot": {"model": model, "friction": {}, "payload": {"mass_kg": [0.1, 1.0]}},
    }))
}

/// Arms under a controller, with everything that it can have.
fn controlled() -> spec::SimulateSpec {
    let fields = json!({
        "preset": "panda-real", "trajectories": 20, "samples": 30, "shard_trajectories": 10,
        "seed": 14, "observations": {"joint_velocities": true, "end_effector_pose": true},
    });
    match spec::parse(fields.to_string().as_bytes()).unwrap() {
        spec::JobSpec::Simulate(spec) => spec,
        other => panic!("{other:?}"),
    }
}

/// Arms whose hands follow paths, or that pulses of torque drive.
fn others(fields: &serde_json::Value) -> spec::SimulateSpec {
    match spec::parse(fields.to_string().as_bytes()).unwrap() {
        spec::JobSpec::Simulate(spec) => spec,
        other => panic!("{other:?}"),
    }
}

fn hand_paths() -> spec::SimulateSpec {
    others(&json!({
        "kind": "simulate", "trajectories": 20, "samples": 30, "shard_trajectories": 10, "seed": 15,
        "excitation": {"hand_paths": {"frequency_hz": {"uniform": [0.2, 0.5]}}},
        "controller": {"law": {"cartesian-impedance": {}}},
    }))
}

fn pulses() -> spec::SimulateSpec {
    others(&json!({
        "kind": "simulate", "trajectories": 20, "samples": 60, "shard_trajectories": 10, "seed": 16,
        "excitation": {"pulses": {"frequency_hz": {"fixed": 2}, "hold_periods": [0.05, 0.2]}},
    }))
}

#[test]
fn torques_of_pulses_are_those_of_their_columns() {
    let dir = tempfile::tempdir().unwrap();
    make(dir.path(), &pulses());
    let series = rows(dir.path(), "trajectories-00000.parquet");
    let robots = rows(dir.path(), "robots-00000.parquet");
    let number =
        |name: String| robots.column_by_name(&name).unwrap().as_primitive::<Float64Type>().value(3);
    let u = series.column_by_name("u2").unwrap().as_primitive::<Float32Type>();
    let part = |what: &str, pulse: usize| number(format!("pulses_{what}{pulse}_s_2"));
    let level = |pulse: usize| number(format!("pulses_level{pulse}_nm_2"));
    let (mut start, mut seen) = (0.0, 0);
    for pulse in (0..4).cycle().take(8) {
        let begins = start + part("rest", pulse) + part("rise", pulse);
        let ends = begins + part("hold", pulse);
        for sample in 0..60_u8 {
            let t = f64::from(sample) / 60.0;
            let held = f64::from(u.value(3 * 60 + usize::from(sample)));
            if begins <= t && t <= ends {
                assert!((held - level(pulse)).abs() < 1e-5, "{held} at {t} s");
                seen += 1;
            }
            if start <= t && t <= start + part("rest", pulse) {
                assert!(held.abs() < 1e-5, "{held} at {t} s");
            }
        }
        start = ends + part("rise", pulse);
    }
    assert!(seen >= 3, "{seen}");
}

#[test]
fn tables_of_controlled_arms_have_references_and_gains() {
    let dir = tempfile::tempdir().unwrap();
    make(dir.path(), &controlled());
    let series = rows(dir.path(), "trajectories-00001.parquet");
    let column =
        |name: &str| series.column_by_name(name).unwrap().as_primitive::<Float32Type>().clone();
    for joint in 1..=7 {
        let (r, q) = (column(&format!("r{joint}")), column(&format!("q{joint}")));
        let off = r.values().iter().zip(q.values()).map(|(r, q)| (r - q).abs());
        assert!((1e-5..0.5).contains(&off.fold(0.0, f32::max)), "joint {joint}");
        assert!(column(&format!("q_measured{joint}")).values() != q.values());
    }
    let robots = rows(dir.path(), "robots-00001.parquet");
    assert!(robots.column_by_name("chirp_depth_1").is_none());
    let text = |name: &str| robots.column_by_name(name).unwrap().as_string::<i32>().clone();
    for (reference, controller) in text("reference").iter().zip(&text("controller")) {
        let [reference, controller]: [serde_json::Value; 2] =
            [reference, controller].map(|text| serde_json::from_str(text.unwrap()).unwrap());
        assert_eq!(controller["kp"].as_array().unwrap().len(), 7);
        assert!(controller["delay_periods"].as_u64().unwrap() <= 2);
        assert!(reference.get("postures_rad").or(reference.get("harmonics")).is_some());
    }
}

#[test]
fn files_have_the_columns_that_the_spec_and_dataset_json_name() {
    let dir = tempfile::tempdir().unwrap();
    let all = [rich(), spec_with(&json!({})), arms_of_six(), controlled(), hand_paths(), pulses()];
    for spec in all {
        let dir = dir.path().join(spec.seed.to_string());
        make(&dir, &spec);
        let description = description(&dir);
        assert_eq!(description.columns.trajectories, spec.trajectory_columns());
        assert_eq!(description.columns.robots, spec.robot_columns());
        for shard in &description.shards {
            for (file, columns) in shard
                .files
                .iter()
                .zip([&description.columns.trajectories, &description.columns.robots])
            {
                let rows = rows(&dir, &file.name);
                assert_eq!(rows.num_rows() as u64, file.rows);
                let found: Vec<Column> = rows
                    .schema()
                    .fields()
                    .iter()
                    .zip(columns)
                    .map(|(field, column)| Column {
                        name: field.name().clone(),
                        nullable: field.is_nullable(),
                        data_type: match field.data_type() {
                            arrow_schema::DataType::Boolean => ColumnType::Boolean,
                            arrow_schema::DataType::Int32 => ColumnType::Int32,
                            arrow_schema::DataType::Int64 => ColumnType::Int64,
                            arrow_schema::DataType::Float32 => ColumnType::Float32,
                            arrow_schema::DataType::Float64 => ColumnType::Float64,
                            _ => ColumnType::Text,
                        },
                        ..column.clone()
                    })
                    .collect();
                assert_eq!(&found, columns, "{}", file.name);
                assert_eq!(rows.num_columns(), columns.len());
            }
        }
        verify(&dir).unwrap();
    }
}

#[test]
fn what_is_off_is_null_and_what_is_on_is_told() {
    let [plain, rich] = [spec_with(&json!({})), rich()].map(|spec| {
        let dir = tempfile::tempdir().unwrap();
        make(dir.path(), &spec);
        rows(dir.path(), "robots-00000.parquet")
    });
    let column = |rows: &arrow_array::RecordBatch, name: &str| {
        rows.column_by_name(name).unwrap().as_primitive::<Float64Type>().clone()
    };
    for name in ["friction_phi1_1", "friction_phi3_7", "payload_mass", "payload_radius"] {
        assert_eq!(column(&plain, name).null_count(), 40, "{name}");
        assert_eq!(column(&rich, name).null_count(), 0, "{name}");
    }
    let masses = column(&rich, "payload_mass");
    assert!(masses.iter().flatten().all(|mass| (0.5..2.0).contains(&mass)));
    assert!(column(&plain, "d_1").iter().flatten().all(|length| length == 0.333));
    assert!(column(&rich, "d_1").iter().flatten().any(|length| length != 0.333));
    assert!(column(&plain, "flange").iter().flatten().all(|length| length == 0.107));
    let compensated = |rows: &arrow_array::RecordBatch| {
        rows.column_by_name("gravity_compensated").unwrap().as_boolean().true_count()
    };
    assert_eq!((compensated(&plain), compensated(&rich)), (0, 40));
    let seed = rich.column_by_name("seed").unwrap().as_primitive::<Int64Type>();
    assert!(seed.values().iter().all(|&seed| seed == 12));
}

/// A simulation without noise has no columns of measurements, and its other columns do not change.
#[test]
fn measured_values_have_columns_where_there_is_noise() {
    let names = |observations: serde_json::Value| {
        let columns = spec_with(&json!({"observations": observations})).trajectory_columns();
        columns.into_iter().map(|column| column.name).skip(16).collect::<Vec<_>>()
    };
    let numbered = |prefix: &str| (1..=7).map(move |k| format!("{prefix}{k}")).collect::<Vec<_>>();
    assert!(names(json!({})).is_empty());
    assert_eq!(names(json!({"position_resolution_rad": 1e-4})), numbered("q_measured"));
    assert_eq!(names(json!({"torque_noise_nm": 0.1})), numbered("u_measured"));
    let both = [numbered("u_measured"), numbered("q_measured")].concat();
    assert_eq!(names(json!({"torque_noise_nm": 0.1, "position_noise_rad": 1e-3})), both);
}

#[test]
fn a_trajectory_begins_where_its_robot_does() {
    let dir = tempfile::tempdir().unwrap();
    make(dir.path(), &rich());
    let steps = rows(dir.path(), "trajectories-00001.parquet");
    let robots = rows(dir.path(), "robots-00001.parquet");
    let ids = robots.column_by_name("trajectory").unwrap().as_primitive::<Int32Type>();
    assert_eq!(ids.values()[..], (40..80).collect::<Vec<i32>>());
    for joint in 1..=7 {
        for (series, initial) in [("q", "q0"), ("qd", "qd0")] {
            let series = steps.column_by_name(&format!("{series}{joint}")).unwrap();
            let initial = robots.column_by_name(&format!("{initial}_{joint}")).unwrap();
            for robot in 0..40 {
                let recorded = f64::from(series.as_primitive::<Float32Type>().value(robot * 50));
                let drawn = initial.as_primitive::<Float64Type>().value(robot);
                assert!((recorded - drawn).abs() < 1e-6, "{joint}: {recorded} {drawn}");
            }
        }
    }
}

#[test]
fn a_footer_says_how_to_make_the_file_again() {
    let dir = tempfile::tempdir().unwrap();
    make(dir.path(), &rich());
    let table = TableReader::open(&dir.path().join("trajectories-00002.parquet")).unwrap();
    let text = table.footer("torqued.spec").unwrap();
    assert_eq!(spec::parse(text.as_bytes()).unwrap().to_json(), description(dir.path()).spec);
    let digest = description(dir.path()).digest.to_string();
    assert_eq!(table.footer("torqued.digest"), Some(digest.as_str()));
    assert_eq!(table.footer("torqued.trajectories"), Some("80..100"));
    let columns: Vec<Column> =
        serde_json::from_str(table.footer("torqued.columns").unwrap()).unwrap();
    assert_eq!(columns, rich().trajectory_columns());
}
