//! `torqued backup` and `restore`: a store is saved during work, and continues elsewhere.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use serde_json::{Value, json};
use spec::Digest;
use testbed::Cluster;

use crate::product::{Product, run_to_end, small_pipeline, torqued, until_gone};
use crate::small_disk::SmallDisk;

fn succeed(command: &mut Command) -> String {
    let (code, output, errors) = run_to_end(command);
    assert_eq!(code, Some(0), "{errors}");
    output
}

fn backup(from: &Path, to: &Path) -> Command {
    let mut command = torqued(&["backup"]);
    command.arg(to).arg("--data").arg(from);
    command
}

fn restore(from: &Path, to: &Path) -> Command {
    let mut command = torqued(&["restore"]);
    command.arg(from).arg("--data").arg(to);
    command
}

/// The lists of everything that was done before the backup.
async fn done(product: &Product) -> Vec<Value> {
    let mut lists = Vec::new();
    for path in ["/v1/jobs?state=succeeded", "/v1/datasets", "/v1/evaluations"] {
        lists.push(product.get(path).await);
    }
    lists
}

/// A long training that keeps all its checkpoints. If it deleted some, the backup might have none.
fn long_training() -> Value {
    let mut spec = small_pipeline()["jobs"]["train"].clone();
    spec["data"] = json!({"stream": {"preset": "D1-multisine", "samples": 60}});
    spec["steps"] = 100_000.into();
    spec["keep_checkpoints"] = 1000.into();
    spec
}

/// Waits until a job has a checkpoint past a step; returns the last one's step.
async fn when_beyond(product: &Product, job: i64, step: u64) -> u64 {
    loop {
        let answer = product.job_when(job, |job| last_checkpoint(job).is_some()).await;
        let id = last_checkpoint(&answer).unwrap();
        // It may have been deleted since the list was read.
        let (_, checkpoint) = product.try_get(&format!("/v1/checkpoints/{id}")).await;
        if let Some(found) = checkpoint["step"].as_u64().filter(|found| *found > step) {
            return found;
        }
        // The server limits each address to some hundred requests a second.
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

fn last_checkpoint(job: &Value) -> Option<i64> {
    job["checkpoints"].as_array()?.iter().filter_map(Value::as_i64).max()
}

/// Downloads every file of every checkpoint that a job has, and compares it with its digest.
async fn download_checkpoints(product: &Product, job: i64) {
    let job = product.get(&format!("/v1/jobs/{job}")).await;
    let ids = job["checkpoints"].as_array().unwrap();
    assert!(!ids.is_empty());
    for id in ids {
        let checkpoint = product.get(&format!("/v1/checkpoints/{id}")).await;
        for file in checkpoint["files"].as_array().unwrap() {
            let bytes = product.download(file["url"].as_str().unwrap()).await;
            assert_eq!(Digest::of(&bytes).to_string(), file["sha256"].as_str().unwrap());
        }
    }
}

#[tokio::test]
async fn a_backup_taken_under_load_is_restored_with_equal_listings_and_goes_on() {
    let folder = || tempfile::tempdir().unwrap();
    let (data, saved, restored) = (folder(), folder(), folder());
    let (saved, restored) = (saved.path().join("backup"), restored.path().join("data"));
    let product = Product::start(data.path());
    let id = product.submit(&small_pipeline()).await;
    product.succeeded(id).await;
    let expected = done(&product).await;
    let training = product.submit(&long_training()).await;
    when_beyond(&product, training, 0).await;

    let said = succeed(&mut backup(data.path(), &saved));
    assert!(said.contains("saved ") && said.contains("torqued restore"), "{said}");
    assert_eq!(product.get(&format!("/v1/jobs/{training}")).await["state"], "running");
    assert_eq!(product.end_by("TERM").0, Some(0));

    succeed(&mut restore(&saved, &restored));
    let (code, _, errors) = run_to_end(&mut restore(&saved, &restored));
    assert_eq!(code, Some(1));
    assert!(errors.contains("choose an empty place"), "{errors}");

    // There are no workers yet.
    let product = Product::start_with(&restored, &["--workers", "0"]);
    assert!(done(&product).await == expected, "the restored store answers otherwise");
    download_checkpoints(&product, training).await;
    let saved_step = when_beyond(&product, training, 0).await;
    assert_eq!(product.end_by("TERM").0, Some(0));
    // The training continues from its checkpoint.
    let product = Product::start(&restored);
    when_beyond(&product, training, saved_step).await;
    let attempts = product.get(&format!("/v1/jobs/{training}/attempts")).await;
    assert_eq!(attempts["attempts"].as_array().unwrap().len(), 2, "{attempts:#}");
    product.post(&format!("/v1/jobs/{training}/cancel"), "").await;
}

/// Caught: `doctor` advised chown, and `backup` wanted to write to the snapshot.
#[tokio::test]
async fn a_snapshot_that_is_mounted_read_only_is_saved() {
    let name = "a_snapshot_that_is_mounted_read_only_is_saved";
    // A server that ended has merged its log into the database, and one that was killed has not.
    for end in ["TERM", "KILL"] {
        let Some(disk) = SmallDisk::mount("64m", name) else { return };
        let data = disk.path().join("data");
        let product = Product::start(&data);
        let job = product.submit(&small_pipeline()["jobs"]["train-set"]).await;
        product.succeeded(job).await;
        let workers = product.workers();
        product.end_by(end);
        for worker in workers {
            until_gone(worker).await;
        }
        disk.make_read_only();
        let nobody = ["--server", "http://127.0.0.1:1"];
        let (code, said, _) = run_to_end(torqued(&["doctor", "--data"]).arg(&data).args(nobody));
        assert!(code == Some(0) && said.contains("mounted read-only"), "{end}: {said}");
        assert!(!said.contains("chown"), "{end}: {said}");
        let folder = tempfile::tempdir().unwrap();
        let said = succeed(&mut backup(&data, &folder.path().join("saved")));
        assert!(said.contains("saved 1 job"), "{end}: {said}");
        let product = Product::start_with(&folder.path().join("saved"), &["--workers", "0"]);
        assert_eq!(product.get(&format!("/v1/jobs/{job}")).await["state"], "succeeded");
    }
}

#[tokio::test]
async fn commands_on_a_store_read_the_configuration_file_of_its_server() {
    let folder = tempfile::tempdir().unwrap();
    let [data, saved, file] =
        ["data", "backup", "torqued.toml"].map(|name| folder.path().join(name));
    std::fs::write(&file, format!("data = {data:?}\nworkers = 0\n")).unwrap();
    let product = Product::start(&data);
    product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    let said = succeed(torqued(&["backup"]).arg(&saved).arg("--config").arg(&file));
    assert!(said.contains("saved 1 job"), "{said}");
    let again = folder.path().join("again");
    let said = succeed(torqued(&["backup"]).arg(&again).env("TORQUED_CONFIG", &file));
    assert!(said.contains("saved 1 job"), "{said}");
    succeed(
        torqued(&["token", "create", "ada", "--scope=admin", "--directly", "--config"]).arg(&file),
    );
    let said = succeed(torqued(&["token", "list", "--directly"]).env("TORQUED_CONFIG", &file));
    assert!(said.contains("ada"), "{said}");
    let said = succeed(torqued(&["gc", "--dry-run", "--config"]).arg(&file));
    assert!(said.contains("would delete 0 things"), "{said}");
}

#[tokio::test]
async fn postgresql_is_saved_into_a_folder_and_restored_into_another_database() {
    let (data, saved) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let saved = saved.path().join("backup");
    let (database, other) = (Cluster::shared().database(), Cluster::shared().database());
    let serve = |data: &Path, url: &str| {
        let mut command = torqued(&["serve", "--listen", "127.0.0.1:0", "--worker-threads", "1"]);
        command.arg("--data").arg(data).env("TORQUED_DATABASE", url);
        Product::spawn(&mut command)
    };
    let product = serve(data.path(), &database.url());
    let id = product.submit(&small_pipeline()).await;
    product.succeeded(id).await;
    let expected = done(&product).await;
    succeed(backup(data.path(), &saved).env("TORQUED_DATABASE", database.url()));

    let elsewhere = tempfile::tempdir().unwrap();
    succeed(restore(&saved, elsewhere.path()).env("TORQUED_DATABASE", other.url()));
    let restored = serve(elsewhere.path(), &other.url());
    assert!(done(&restored).await == expected, "the restored store answers otherwise");
}
