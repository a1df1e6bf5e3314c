use std::path::Path;
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::Float32Type;
use arrow_array::{ArrayRef, Float32Array, RecordBatch};
use store::DatasetDescription;
use tempfile::TempDir;

use super::fixture::{description, make, rewrite_trajectories, rows, spec, verify};

const FILE: &str = "trajectories-00001.parquet";

fn made() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    make(dir.path(), &spec());
    dir
}

fn fails(dir: &Path) -> String {
    verify(dir).expect_err("a changed dataset was verified")
}

/// The rows, with `q3` of trajectory 42 at step 7 changed by `by`.
fn moved(rows: &RecordBatch, by: f32) -> RecordBatch {
    let place = rows.schema().index_of("q3").unwrap();
    let mut values = rows.column(place).as_primitive::<Float32Type>().values().to_vec();
    values[2 * 50 + 7] += by;
    let mut columns = rows.columns().to_vec();
    columns[place] = Arc::new(Float32Array::from(values)) as ArrayRef;
    RecordBatch::try_new(rows.schema(), columns).unwrap()
}

#[test]
fn an_untouched_dataset_is_equal_to_the_last_byte() {
    let dir = made();
    let verified = verify(dir.path()).unwrap();
    assert_eq!((verified.shards, verified.trajectories), (3, 100));
    assert!(verified.by_other_versions.is_empty());
}

/// The Parquet decoder panics on some damaged pages.
#[test]
fn any_changed_byte_is_found_and_told_without_a_panic() {
    let dir = made();
    for name in [FILE, "robots-00001.parquet"] {
        let path = dir.path().join(name);
        let bytes = std::fs::read(&path).unwrap();
        for position in (0..bytes.len()).step_by(bytes.len() / 25) {
            let mut changed = bytes.clone();
            changed[position] ^= 0x55;
            std::fs::write(&path, changed).unwrap();
            let error = fails(dir.path());
            assert!(error.contains("shard 00001") && error.contains(name), "{position}: {error}");
        }
        std::fs::write(&path, &bytes).unwrap();
    }
    verify(dir.path()).unwrap();
}

#[test]
fn a_truncated_or_missing_file_is_told() {
    let dir = made();
    let path = dir.path().join(FILE);
    let bytes = std::fs::read(&path).unwrap();
    for length in [0, 3, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..length]).unwrap();
        let error = fails(dir.path());
        assert!(error.contains(&format!("checksum mismatch of {FILE}: {length} bytes")), "{error}");
    }
    std::fs::remove_file(&path).unwrap();
    assert_eq!(fails(dir.path()), format!("shard 00001: {FILE} is missing"));
}

#[test]
fn a_changed_value_is_named_with_its_place_and_both_values() {
    let dir = made();
    let rows = rows(dir.path(), FILE);
    let changed = moved(&rows, 1e-3);
    let value = |rows: &RecordBatch| {
        rows.column_by_name("q3").unwrap().as_primitive::<Float32Type>().value(2 * 50 + 7)
    };
    rewrite_trajectories(dir.path(), 1, changed.clone(), env!("CARGO_PKG_VERSION"));
    let expected = format!(
        "trajectory 42, column q3, step 7: {} instead of {}",
        value(&changed),
        value(&rows)
    );
    let error = fails(dir.path());
    assert!(error.contains(&expected), "{error}");

    // Changing only the file does not help either.
    let path = dir.path().join(FILE);
    let bytes = std::fs::read(&path).unwrap();
    let honest = made();
    std::fs::write(honest.path().join(FILE), bytes).unwrap();
    let error = fails(honest.path());
    assert!(error.contains(&expected) && error.contains("checksum mismatch"), "{error}");
}

#[test]
fn a_file_of_another_version_may_differ_in_bytes_and_rounding_but_not_in_values() {
    let dir = made();
    let rows = rows(dir.path(), FILE);
    rewrite_trajectories(dir.path(), 1, moved(&rows, 2e-6), "0.0.1");
    let verified = verify(dir.path()).unwrap();
    assert_eq!(verified.by_other_versions.len(), 1);
    let note = &verified.by_other_versions[0];
    assert!(note.contains("shard 00001") && note.contains("version 0.0.1"), "{note}");

    rewrite_trajectories(dir.path(), 1, moved(&rows, 1e-2), "0.0.1");
    let error = fails(dir.path());
    assert!(error.contains("trajectory 42, column q3, step 7"), "{error}");
}

#[test]
fn a_file_without_all_its_rows_or_columns_is_told() {
    let dir = made();
    let rows = rows(dir.path(), FILE);
    rewrite_trajectories(dir.path(), 1, rows.slice(0, 39 * 50), "0.0.1");
    assert!(fails(dir.path()).contains("1950 rows instead of 2000"), "{}", fails(dir.path()));
    rewrite_trajectories(dir.path(), 1, rows.project(&[0, 1, 2, 3]).unwrap(), "0.0.1");
    assert!(fails(dir.path()).contains("no column u3"), "{}", fails(dir.path()));
}

#[test]
fn a_description_that_was_tampered_with_is_refused() {
    let dir = made();
    let original = description(dir.path());
    let path = dir.path().join(DatasetDescription::FILE_NAME);
    let tampered: [fn(&mut DatasetDescription); 4] = [
        |dataset| dataset.spec["seed"] = 99.into(),
        |dataset| dataset.spec["trajectories"] = u64::MAX.into(),
        |dataset| dataset.shards[1].first = 7,
        |dataset| dataset.shards[1].files[0].name = "../secret".to_owned(),
    ];
    for tamper in tampered {
        let mut description = original.clone();
        tamper(&mut description);
        std::fs::write(&path, description.to_json()).unwrap();
        fails(dir.path());
    }
    std::fs::write(&path, "{}").unwrap();
    assert!(fails(dir.path()).contains("cannot read"));
}
