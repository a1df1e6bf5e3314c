//! The worst specs that fit into a request of 1 MiB: a list of 10 000 joints took 96 s, and 88 000
//! unknown fields made an answer of 35 MB.

use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};
use spec::{ALLOWED_BYTES, FIELD_BYTES, LISTED_VIOLATIONS, SpecError, VALUE_BYTES};

use super::{simulate, train};

/// Bytes of a request with a spec.
const BODY: usize = 1 << 20;

/// Before, the slowest spec took a hundred times as long as this. Checks in proportion to the size
/// take some 0.1 s.
const WITHIN: Duration = Duration::from_secs(8);

fn refused(name: &str, spec: &Value) -> SpecError {
    let text = spec.to_string();
    assert!(text.len() <= BODY, "{name} has {} bytes", text.len());
    let began = Instant::now();
    let error = spec::parse(text.as_bytes()).unwrap_err();
    let took = began.elapsed();
    assert!(took < WITHIN, "{name} took {took:?}");
    assert!((1..=LISTED_VIOLATIONS).contains(&error.violations.len()), "{name}");
    for violation in &error.violations {
        assert!(violation.field.len() <= FIELD_BYTES, "{name}: {}", violation.field);
        assert!(violation.value.len() <= VALUE_BYTES, "{name}: {}", violation.value);
        assert!(violation.allowed.len() <= ALLOWED_BYTES, "{name}: {}", violation.allowed);
    }
    error
}

fn with(mut base: Value, field: &str, value: Value) -> Value {
    base[field] = value;
    base
}

fn pipeline(jobs: &Map<String, Value>) -> Value {
    json!({"kind": "pipeline", "name": "worst", "jobs": jobs})
}

fn repeated(item: &Value, times: usize) -> Value {
    vec![item.clone(); times].into()
}

#[test]
fn ten_thousand_joints_without_a_name_are_counted_in_one_walk() {
    let joints = repeated(&json!({"a_m": 0}), 100_000 / 9);
    let robot = json!({"model": {"name": "worst", "joints": joints}});
    let error = refused("joints", &with(simulate(), "robot", robot));
    assert_eq!(error.violations.len(), LISTED_VIOLATIONS);
    assert!(error.violations[0].field.starts_with("robot.model."), "{}", error.violations[0]);
    assert!(error.more > 10_000, "{}", error.more);
    assert!(error.to_string().ends_with(&format!("; and {} more", error.more)));
}

#[test]
fn unknown_fields_are_counted() {
    let mut spec = simulate();
    for i in 0..88_000 {
        spec[format!("f{i}")] = json!(0);
    }
    let error = refused("unknown fields", &spec);
    assert_eq!((error.violations.len(), error.more), (100, 87_900));
}

#[test]
fn a_megabyte_as_a_name_is_cut_and_compared_with_no_other() {
    let long = "n".repeat(1_000_000);
    let places = [
        with(simulate(), &long, json!(0)),
        with(simulate(), "kind", json!(long)),
        with(simulate(), "preset", json!(long)),
        with(simulate(), "robot", json!({"model": long})),
        with(simulate(), "integrator", json!({"scheme": long})),
        with(simulate(), "integrator", json!(long)),
        with(train(), "model", json!(long)),
        with(train(), "model", json!({"architecture": long})),
        with(train(), "data", json!({"job": long})),
        with(train(), "data", json!({"digest": long})),
        with(train(), "execution", json!({"not_before": long})),
        with(train(), "execution", json!({"resources": {"tags": [long]}})),
        json!(long),
        pipeline(&Map::from_iter([(long.clone(), json!({}))])),
        pipeline(&Map::from_iter([(long.clone(), with(train(), "step", json!(1)))])),
        pipeline(&Map::from_iter([("train".to_owned(), with(train(), "needs", json!([long])))])),
    ];
    for (i, spec) in places.iter().enumerate() {
        let error = refused(&format!("place {i}"), spec);
        assert!(error.to_string().len() < 10_000, "place {i}: {}", error.to_string().len());
    }
    // A path of many parts with many faults inside.
    let dotted = "a.[".repeat(150_000);
    let fields: Map<String, Value> = (0..40_000).map(|i| (format!("f{i}"), json!(0))).collect();
    let robot = json!({"model": {"name": 1}, dotted: fields});
    refused("a dotted name", &with(simulate(), "robot", robot));
}

#[test]
fn lists_that_are_too_long_are_searched_once_for_what_is_there_twice() {
    let ids = |most: usize| -> Value {
        (1..=most).map(|id| json!({"checkpoint": id})).collect::<Vec<_>>().into()
    };
    let numbers: Value = (0..120_000).map(|i| json!(i)).collect::<Vec<_>>().into();
    let described: Value =
        (0..4_000).map(|i| json!({"name": format!("p{i}"), "data": {"dataset": i}})).collect();
    let columns: Vec<String> = (0..30_000).map(|i| format!("c{i}")).collect();
    let evaluate = json!({"kind": "evaluate"});
    let control = json!({"kind": "control", "data": {"dataset": 1}});
    let import = json!({
        "kind": "import", "format": "csv", "file": "0".repeat(64),
        "columns": {"u": columns, "q": columns, "qd": columns},
    });
    let grid = json!({"chirp": {"frequency_hz": {"grid": numbers}}});
    for (name, spec) in [
        ("checkpoints of an evaluation", with(evaluate.clone(), "checkpoints", ids(46_000))),
        ("checkpoints of a control", with(control, "checkpoints", ids(46_000))),
        ("samplers", with(evaluate.clone(), "samplers", repeated(&json!({}), 300_000))),
        ("levels of noise", with(evaluate.clone(), "position_noise_rad", numbers)),
        ("predictions", with(evaluate, "predictions", described)),
        ("frequencies", with(simulate(), "excitation", grid)),
        ("weights", with(train(), "loss_weights", repeated(&json!(-1), 300_000))),
        ("columns", import),
    ] {
        refused(name, &spec);
    }
}

#[test]
fn an_import_for_thousands_of_joints_compares_each_column_once() {
    let Value::Object(mut robot) =
        serde_json::to_value(spec::RobotModel::panda().description()).unwrap()
    else {
        panic!("a description is an object");
    };
    let mut joint = robot["joints"][0].clone();
    joint.as_object_mut().unwrap().retain(|_, value| !value.is_null());
    let joints = 900_000 / (joint.to_string().len() + 20);
    robot["joints"] = repeated(&joint, joints);
    let names = |letter: char| (0..joints).map(|i| format!("{letter}{i}")).collect::<Vec<_>>();
    let spec = json!({
        "kind": "import", "format": "csv", "file": "0".repeat(64), "robot": {"model": robot},
        "columns": {"u": names('u'), "q": names('q')},
    });
    let error = refused("an import for many joints", &spec);
    assert!(error.to_string().contains("1 to 8 joints"), "{error}");
}

#[test]
fn the_jobs_of_a_pipeline_are_counted_before_they_are_read() {
    let jobs = |number: usize, job: &Value| -> Map<String, Value> {
        (0..number).map(|i| (format!("job-{i}"), job.clone())).collect()
    };
    let error = refused("88 000 jobs", &pipeline(&jobs(60_000, &json!({}))));
    assert_eq!(error.to_string(), "jobs is 60000 jobs, allowed: 1 to 200 jobs");
    let error = refused("200 jobs without a kind", &pipeline(&jobs(200, &json!({}))));
    assert_eq!((error.violations.len(), error.more), (100, 100));
    let unknown = repeated(&json!("nobody"), 500);
    refused("needs", &pipeline(&jobs(200, &with(train(), "needs", unknown))));
    let one = with(train(), "needs", repeated(&json!("nobody"), 100_000));
    let error = refused("needs of one job", &pipeline(&jobs(1, &one)));
    assert_eq!(error.count(), 100_000);
}

#[test]
fn a_value_of_another_shape_is_shown_by_its_beginning() {
    let nested = (0..120).fold(json!(0), |inner, _| json!([inner]));
    for (name, value) in [
        ("a list of lists", repeated(&json!([[], []]), 100_000)),
        ("a nested list", nested),
        ("a list of objects", repeated(&json!({"": 0}), 100_000)),
        ("a list of numbers", repeated(&json!(0), 300_000)),
        ("an object of numbers", (0..60_000).map(|i| (format!("{i}"), json!(i))).collect()),
    ] {
        for field in ["samples", "excitation", "robot", "integrator", "seed", "execution"] {
            refused(&format!("{name} as {field}"), &with(simulate(), field, value.clone()));
        }
        for field in ["model", "data", "loss_weights", "normalization"] {
            refused(&format!("{name} as {field}"), &with(train(), field, value.clone()));
        }
    }
}
