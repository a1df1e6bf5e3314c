//! `torqued doctor` beside a running server: no output without problems, and otherwise a line with
//! the remedy.

use std::fs;
use std::path::{Path, PathBuf};

use crate::product::{Product, run_to_end, small_pipeline, torqued};

fn doctor(data: &Path, more: &[&str]) -> (Option<i32>, String) {
    let (code, output, errors) = run_to_end(torqued(&["doctor", "--data"]).arg(data).args(more));
    (code, output + &errors)
}

/// A Parquet file of the store.
fn shard(folder: &Path) -> Option<PathBuf> {
    fs::read_dir(folder).unwrap().flatten().map(|entry| entry.path()).find_map(|path| {
        if path.is_dir() {
            return shard(&path);
        }
        path.extension().is_some_and(|extension| extension == "parquet").then_some(path)
    })
}

#[tokio::test]
async fn a_missing_and_a_damaged_file_are_found_beside_a_running_server() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let product = Product::start(&data);
    let job = product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    product.succeeded(job).await;
    let url = product.url.clone();
    let server = ["--server", url.as_str()];
    let with_bytes = ["--bytes", "--server", url.as_str()];
    let (code, output) = doctor(&data, &server);
    assert_eq!(code, Some(0), "{output}");
    for words in ["clock", "behind seccomp", "mode 700", "sound", "8 of ", ", 1 worker", "0 wrong"]
    {
        assert!(output.contains(words), "no {words:?} in {output}");
    }

    let path = shard(&data.join("objects")).unwrap();
    let sound = fs::read(&path).unwrap();
    let mut damaged = sound.clone();
    damaged[sound.len() / 2] ^= 1;
    fs::write(&path, &damaged).unwrap();
    assert_eq!(doctor(&data, &server).0, Some(0), "its size is right");
    let (code, output) = doctor(&data, &with_bytes);
    assert!(code == Some(1) && output.contains("is damaged: expected"), "{output}");
    fs::remove_file(&path).unwrap();
    let (code, output) = doctor(&data, &server);
    assert!(code == Some(1) && output.contains(" is missing; "), "{output}");
    fs::write(&path, &sound).unwrap();
    assert_eq!(doctor(&data, &with_bytes).0, Some(0));

    // No server runs, and nothing is wrong.
    product.end_by("TERM");
    let (code, output) = doctor(&data, &server);
    assert!(code == Some(0) && output.contains("none answers"), "{output}");
    let lines = doctor(&data, &["--json", "--server", "http://127.0.0.1:1"]).1;
    for line in lines.lines() {
        let finding: serde_json::Value = serde_json::from_str(line).unwrap();
        assert!(finding["thing"].is_string() && finding["state"].is_string(), "{finding}");
    }
}

#[test]
fn a_folder_that_is_no_store_is_told_from_one_that_is_not_there() {
    let folder = tempfile::tempdir().unwrap();
    let nobody = ["--server", "http://127.0.0.1:1"];
    let (code, output) = doctor(&folder.path().join("none"), &nobody);
    assert!(code == Some(0) && output.contains("torqued serve creates it"), "{output}");
    fs::write(folder.path().join("torqued.sqlite"), "no database at all").unwrap();
    let (code, output) = doctor(folder.path(), &nobody);
    assert!(code == Some(1) && output.contains("WRONG  database"), "{output}");
}
