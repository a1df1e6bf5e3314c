use std::ops::ControlFlow;
use std::os::unix::fs::MetadataExt;

use serde_json::json;
use worker::{DatasetFolder, FolderError};

use super::fixture::{description, digests, make, spec, spec_with};

fn on(_: u64) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

#[test]
fn a_folder_gets_the_same_bytes_with_any_number_of_threads() {
    let whole = tempfile::tempdir().unwrap();
    make(whole.path(), &spec());
    for threads in [1, 3] {
        let dir = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| make(dir.path(), &spec()));
        assert_eq!(digests(dir.path()), digests(whole.path()), "{threads} threads");
    }
}

#[test]
fn a_stopped_simulation_keeps_whole_shards_and_goes_on_from_them() {
    let whole = tempfile::tempdir().unwrap();
    make(whole.path(), &spec());
    let dir = tempfile::tempdir().unwrap();
    let mut folder = DatasetFolder::begin(dir.path(), &spec()).unwrap();
    let stop_in_the_second_shard =
        |done| if done > 50 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let error = folder.complete(&stop_in_the_second_shard).unwrap_err();
    assert!(matches!(error, FolderError::Stopped), "{error}");
    drop(folder);
    let names: Vec<String> = digests(dir.path()).into_keys().collect();
    assert_eq!(names, ["dataset.json", "robots-00000.parquet", "trajectories-00000.parquet"]);
    let part = description(dir.path());
    assert_eq!((part.complete, part.trajectories, part.shards.len()), (false, 40, 1));
    let error = DatasetFolder::open(dir.path()).unwrap_err().to_string();
    assert!(error.contains("1 of 3 shards"), "{error}");

    let first = dir.path().join("trajectories-00000.parquet");
    let inode = std::fs::metadata(&first).unwrap().ino();
    make(dir.path(), &spec());
    assert_eq!(digests(dir.path()), digests(whole.path()));
    assert_eq!(std::fs::metadata(&first).unwrap().ino(), inode, "made again");
}

#[test]
fn shards_with_other_bytes_than_were_written_are_made_again() {
    let whole = tempfile::tempdir().unwrap();
    make(whole.path(), &spec());
    let dir = tempfile::tempdir().unwrap();
    make(dir.path(), &spec());
    std::fs::remove_file(dir.path().join("robots-00000.parquet")).unwrap();
    std::fs::write(dir.path().join("trajectories-00002.parquet"), "cut").unwrap();
    make(dir.path(), &spec());
    assert_eq!(digests(dir.path()), digests(whole.path()));
}

#[test]
fn what_a_killed_simulation_left_half_written_does_not_stay() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join(".trajectories-00000.parquet.unfinished"), "half").unwrap();
    std::fs::write(dir.path().join(".dataset.json.unfinished"), "{").unwrap();
    make(dir.path(), &spec());
    let names: Vec<String> = digests(dir.path()).into_keys().collect();
    assert!(!names.iter().any(|name| name.starts_with('.')), "{names:?}");
}

#[test]
fn a_folder_with_anything_else_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    make(dir.path(), &spec());
    let before = digests(dir.path());
    let error = DatasetFolder::begin(dir.path(), &spec_with(&json!({"seed": 5}))).unwrap_err();
    assert!(error.to_string().contains("has a dataset with digest"), "{error}");
    assert_eq!(digests(dir.path()), before);

    let other = tempfile::tempdir().unwrap();
    std::fs::write(other.path().join("thesis.tex"), "precious").unwrap();
    let error = DatasetFolder::begin(other.path(), &spec()).unwrap_err();
    assert!(matches!(error, FolderError::NotEmpty { .. }), "{error}");
    assert_eq!(digests(other.path()).len(), 1);

    let error = DatasetFolder::open(other.path()).unwrap_err();
    assert!(matches!(error, FolderError::NoDataset { .. }), "{error}");
}

#[test]
fn how_a_job_is_run_leaves_the_bytes_alone() {
    let [a, b] = [json!({}), json!({"execution": {"priority": 7}})].map(|fields| {
        let dir = tempfile::tempdir().unwrap();
        make(dir.path(), &spec_with(&fields));
        digests(dir.path())
    });
    assert_eq!(a, b);
}

#[test]
fn two_processes_do_not_write_into_the_same_folder() {
    let dir = tempfile::tempdir().unwrap();
    let first = DatasetFolder::begin(dir.path(), &spec()).unwrap();
    let error = DatasetFolder::begin(dir.path(), &spec()).unwrap_err();
    assert!(matches!(error, FolderError::InUse { .. }), "{error}");
    drop(first);
    DatasetFolder::begin(dir.path(), &spec()).unwrap().complete(&on).unwrap();
}
