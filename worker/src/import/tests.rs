use std::ops::ControlFlow;

use recordings::Frames;
use serde_json::{Value, json};
use spec::{ImportSpec, JobSpec};
use store::ObjectWriter;

use super::{WrittenImport, convert};
use crate::error::TaskError;

fn spec(fields: &Value) -> ImportSpec {
    let names = |prefix: &str| (1..=7).map(|i| format!("{prefix}{i}")).collect::<Vec<_>>();
    let mut spec = json!({
        "kind": "import", "file": "0".repeat(64), "format": "csv", "samples": 40,
        "split": {"kind": "windows", "stride": 20}, "columns": {"u": names("u"), "q": names("q")},
    });
    for (field, value) in fields.as_object().unwrap() {
        spec[field] = value.clone();
    }
    match ::spec::parse(spec.to_string().as_bytes()).unwrap() {
        JobSpec::Import(spec) => spec,
        other => panic!("{other:?}"),
    }
}

/// A conversion that writes no files and keeps only digests and counts.
fn converted(spec: &ImportSpec) -> WrittenImport {
    let mut file = spec.columns.named().iter().map(|(_, name)| *name).collect::<Vec<_>>().join(",");
    for row in 0..100 {
        let values =
            (0..14).map(|channel| (f64::from(row + 14 * channel) / 50.0).sin().to_string());
        file.push('\n');
        file.push_str(&values.collect::<Vec<_>>().join(","));
    }
    let mut frames = Vec::new();
    recordings::decode(bytes::Bytes::from(file), spec, &mut frames).unwrap();
    let (trajectories, table) = (ObjectWriter::digest_only("a"), ObjectWriter::digest_only("b"));
    let rows = Frames::new(&frames[..], spec).map(|rows| rows.map_err(TaskError::from));
    convert(rows, spec, trajectories, table, &|_| ControlFlow::Continue(())).unwrap()
}

#[test]
fn the_bytes_are_a_function_of_file_and_spec() {
    let first = converted(&spec(&json!({})));
    assert_eq!(first.shard.count, 4);
    let again = converted(&spec(&json!({})));
    assert_eq!(first.shard.trajectories, again.shard.trajectories);
    assert_eq!(first.shard.robots, again.shard.robots);
    let hurried = converted(&spec(&json!({"execution": {"priority": 9}})));
    assert_eq!(first.shard.trajectories.sha256, hurried.shard.trajectories.sha256);
    let other = converted(&spec(&json!({"split": {"kind": "windows", "stride": 21}})));
    assert_ne!(first.shard.trajectories.sha256, other.shard.trajectories.sha256);
}
