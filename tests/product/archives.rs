//! Downloads a dataset as one tar: with curl, which continues after an interruption, piped into
//! tar.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::product::{Product, run_to_end, skip, small_pipeline};

fn curl(arguments: &[&str], out: &Path) -> Option<i32> {
    let mut command = Command::new("curl");
    command.args(["--silent", "--fail", "--noproxy", "*", "--output"]).arg(out).args(arguments);
    run_to_end(&mut command).0
}

#[tokio::test]
async fn curl_goes_on_with_a_tar_that_was_interrupted_and_tar_unpacks_it() {
    if Command::new("curl").arg("--version").output().is_err() {
        return skip("archives", "there is no curl");
    }
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let job = product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    product.succeeded(job).await;
    let url = format!("{}/v1/datasets/1/tar", product.url);
    let whole = data.path().join("whole.tar");
    assert_eq!(curl(&[&url], &whole), Some(0));

    let part = data.path().join("part.tar");
    let bytes = fs::read(&whole).unwrap();
    fs::write(&part, &bytes[..bytes.len() / 2]).unwrap();
    assert_eq!(curl(&["--continue-at", "-", &url], &part), Some(0));
    assert_eq!(fs::read(&part).unwrap(), bytes);

    let mut tar = Command::new("tar");
    let unpacking = tar.arg("-xf").arg(&part).arg("-C").arg(data.path());
    assert_eq!(run_to_end(unpacking).0, Some(0));
    for file in product.get("/v1/datasets/1").await["files"].as_array().unwrap() {
        let path = data.path().join("dataset-1").join(file["name"].as_str().unwrap());
        assert_eq!(fs::metadata(&path).unwrap().len(), file["size"], "{}", path.display());
    }
}
