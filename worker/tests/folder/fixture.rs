use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;

use arrow_array::RecordBatch;
use serde_json::{Value, json};
use spec::{Digest, JobSpec, SimulateSpec};
use store::{DatasetDescription, FileContent, ObjectWriter, TableReader, TableWriter};
use worker::DatasetFolder;

/// Three shards, of 40, 40 and 20 trajectories.
pub fn spec() -> SimulateSpec {
    spec_with(&json!({}))
}

pub fn spec_with(fields: &Value) -> SimulateSpec {
    let mut spec = json!({
        "preset": "D2-mixed", "trajectories": 100, "samples": 50, "shard_trajectories": 40,
    });
    spec.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    match spec::parse(spec.to_string().as_bytes()).unwrap() {
        JobSpec::Simulate(spec) => spec,
        other => panic!("{other:?}"),
    }
}

/// Makes the whole dataset of a spec.
pub fn make(dir: &Path, spec: &SimulateSpec) {
    let mut folder = DatasetFolder::begin(dir, spec).unwrap();
    folder.complete(&|_| ControlFlow::Continue(())).unwrap();
}

/// The result of `verify` on a folder.
pub fn verify(dir: &Path) -> Result<worker::Verified, String> {
    let folder = DatasetFolder::open(dir).map_err(|error| error.to_string())?;
    folder.verify(&|_| ControlFlow::Continue(())).map_err(|error| error.to_string())
}

/// SHA-256 of every file, by name. Hidden files are included.
pub fn digests(dir: &Path) -> BTreeMap<String, Digest> {
    let files = std::fs::read_dir(dir).unwrap().map(Result::unwrap);
    files
        .map(|file| {
            let name = file.file_name().into_string().unwrap();
            (name, Digest::of(&std::fs::read(file.path()).unwrap()))
        })
        .collect()
}

pub fn description(dir: &Path) -> DatasetDescription {
    let text = std::fs::read(dir.join(DatasetDescription::FILE_NAME)).unwrap();
    serde_json::from_slice(&text).unwrap()
}

/// All rows of a table.
pub fn rows(dir: &Path, name: &str) -> RecordBatch {
    let table = TableReader::open(&dir.join(name)).unwrap();
    let columns = table.columns();
    let groups: Vec<_> = (0..table.row_groups().count())
        .map(|group| table.read_row_group(group, &columns).unwrap())
        .collect();
    arrow_select::concat::concat_batches(&groups[0].schema(), &groups).unwrap()
}

/// Writes trajectories as version `version` of torqued would, and updates `dataset.json`.
pub fn rewrite_trajectories(dir: &Path, shard: usize, rows: RecordBatch, version: &str) {
    let mut description = description(dir);
    let file = &mut description.shards[shard].files[0];
    assert_eq!(file.content, FileContent::Trajectories);
    let footer = BTreeMap::from([("torqued.version".to_owned(), version.to_owned())]);
    let object = ObjectWriter::in_folder(dir, &file.name).unwrap();
    let mut writer =
        TableWriter::trajectories(object, rows.schema(), description.samples, &footer).unwrap();
    writer.write(rows).unwrap();
    let written = writer.finish().unwrap();
    (file.size, file.sha256) = (written.size, written.sha256);
    std::fs::write(dir.join(DatasetDescription::FILE_NAME), description.to_json()).unwrap();
}
