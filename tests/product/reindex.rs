//! A lost database is rebuilt from the files of datasets and checkpoints.

use std::path::Path;
use std::process::Command;

use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::product::{Product, run_to_end, torqued};
use crate::s3_server::S3Server;

/// A data folder, and a bucket for its objects if there is one.
struct Place<'a> {
    folder: &'a Path,
    bucket: Option<&'a S3Server>,
}

impl Place<'_> {
    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = torqued(arguments);
        command.arg("--data").arg(self.folder);
        if let Some(bucket) = self.bucket {
            command.env("TORQUED_OBJECTS", S3Server::url("arm").to_string());
            command.envs(bucket.variables());
        }
        command
    }

    fn server(&self) -> Product {
        let arguments = ["serve", "--listen", "127.0.0.1:0", "--worker-threads", "1"];
        Product::spawn(&mut self.command(&arguments))
    }

    fn lose_the_database(&self) {
        for file in ["torqued.sqlite", "torqued.sqlite-wal", "torqued.sqlite-shm"] {
            let _ = std::fs::remove_file(self.folder.join(file));
        }
    }
}

fn simulation(seed: u64) -> Value {
    json!({
        "preset": "D1-multisine", "trajectories": 40, "shard_trajectories": 20, "samples": 60, "seed": seed,
    })
}

fn training(dataset: &Value) -> Value {
    json!({
        "kind": "train", "data": {"dataset": dataset}, "context": 40, "batch_size": 4, "steps": 6,
        "checkpoint_every_steps": 2, "keep_checkpoints": 3, "optimizer": {"warmup_steps": 0},
        "validation_fraction": 0.1, "model": {"preset": "cdt-tiny"}, "normalization": "dataset",
    })
}

/// All properties of datasets and checkpoints, except their times.
async fn listings(product: &Product) -> Value {
    let mut listings = json!({});
    for list in ["datasets", "checkpoints"] {
        let mut items = product.get(&format!("/v1/{list}?limit=100")).await[list].take();
        for item in items.as_array_mut().unwrap() {
            for moment in ["created_at", "completed_at"] {
                item.as_object_mut().unwrap().remove(moment);
            }
            let mut whole = product.get(&format!("/v1/{list}/{}", item["id"])).await;
            item["files"] = whole["files"].take();
        }
        listings[list] = items;
    }
    listings
}

async fn prediction(product: &Product, checkpoint: &Value) -> Value {
    let rows = |count: usize, value: f64| vec![[value; 7]; count];
    let scenario = json!({"u": rows(40, 0.5), "y": rows(40, 0.1), "future_u": rows(20, 1.0)});
    let question = json!({"scenarios": [scenario], "sampling": {"samples": 2}}).to_string();
    let path = format!("/v1/checkpoints/{checkpoint}/predict");
    let (status, mut answer) = product.post(&path, question).await;
    assert_eq!(status, StatusCode::OK, "{answer}");
    answer["scenarios"].take()
}

async fn loses_its_database_and_gets_it_again(place: &Place<'_>) {
    let product = place.server();
    let mut jobs = Vec::new();
    for seed in [1, 2] {
        let job = product.submit(&simulation(seed)).await;
        jobs.push(product.succeeded(job).await);
    }
    let dataset = jobs[1]["dataset"].clone();
    let trained = product.submit(&training(&dataset)).await;
    let trained = product.succeeded(trained).await;
    let checkpoint = trained["checkpoints"].as_array().unwrap().last().unwrap().clone();
    let (before, predicted) = (listings(&product).await, prediction(&product, &checkpoint).await);
    assert_eq!(before["datasets"].as_array().unwrap().len(), 2);
    let last = &before["checkpoints"][0];
    assert_eq!(last["final"], true);
    assert_eq!(product.end_by("TERM").0, Some(0));

    place.lose_the_database();
    let (code, output, errors) = run_to_end(&mut place.command(&["reindex"]));
    assert_eq!(code, Some(0), "{errors}");
    assert!(
        output.contains("2 datasets with 4 shards, 1 trainings with 3 checkpoints"),
        "{output}"
    );
    let (code, _, errors) = run_to_end(&mut place.command(&["reindex"]));
    assert_eq!(code, Some(1));
    assert!(errors.contains("only a database without jobs can be rebuilt"), "{errors}");

    let product = place.server();
    let after = listings(&product).await;
    assert_eq!(without_ids(&after), without_ids(&before));
    let found = &after["checkpoints"][0];
    assert_eq!(found["job"], trained["id"]);
    assert_eq!(found["run"], trained["run"]);
    assert_eq!(prediction(&product, &found["id"]).await, predicted);
    // Finished jobs do not run again.
    for (spec, job) in [(simulation(2), &jobs[1]), (training(&dataset), &trained)] {
        let (status, answer) = product.post("/v1/jobs", spec.to_string()).await;
        assert_eq!((status, &answer["id"]), (StatusCode::OK, &job["id"]), "{answer}");
        assert_eq!((&answer["state"], &answer["digest"]), (&json!("succeeded"), &job["digest"]));
    }
    // New results lie beside the recovered ones.
    let job = product.submit(&simulation(3)).await;
    assert!(job > trained["id"].as_i64().unwrap());
    product.succeeded(job).await;
    assert_eq!(product.end_by("TERM").0, Some(0));
}

/// Checkpoints get new ids, because deleted ones have left gaps.
fn without_ids(listings: &Value) -> Value {
    let mut listings = listings.clone();
    for checkpoint in listings["checkpoints"].as_array_mut().unwrap() {
        checkpoint["id"] = Value::Null;
        for file in checkpoint["files"].as_array_mut().unwrap() {
            file["url"] = Value::Null;
        }
    }
    listings
}

#[tokio::test]
async fn a_database_that_is_lost_is_made_again_from_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    loses_its_database_and_gets_it_again(&Place { folder: folder.path(), bucket: None }).await;
}

#[tokio::test]
async fn a_database_that_is_lost_is_made_again_from_a_bucket() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = S3Server::start();
    let place = Place { folder: folder.path(), bucket: Some(&bucket) };
    loses_its_database_and_gets_it_again(&place).await;
}

#[tokio::test]
async fn what_is_lost_is_made_again_and_what_is_damaged_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let place = Place { folder: folder.path(), bucket: None };
    let product = place.server();
    let job = product.submit(&simulation(1)).await;
    let dataset = product.succeeded(job).await["dataset"].clone();
    let trained = product.submit(&training(&dataset)).await;
    product.succeeded(trained).await;
    let before = listings(&product).await;
    assert_eq!(product.end_by("TERM").0, Some(0));

    place.lose_the_database();
    let objects = folder.path().join("objects");
    std::fs::remove_file(objects.join(format!("datasets/{job}/shard-00001-e1-robots.parquet")))
        .unwrap();
    std::fs::write(objects.join("notes.txt"), "mine").unwrap();
    let (code, _, errors) = run_to_end(&mut place.command(&["reindex"]));
    assert_eq!(code, Some(1));
    for named in ["notes.txt: it does not describe itself", "its robots are missing", "--leave-out"]
    {
        assert!(errors.contains(named), "{named}: {errors}");
    }
    let (code, output, errors) = run_to_end(&mut place.command(&["reindex", "--leave-out"]));
    assert_eq!(code, Some(0), "{errors}");
    assert!(output.contains(&format!("missing parts of jobs {job}")), "{output}");
    // The training waits for its data, so its checkpoints cannot be judged.
    assert!(errors.contains("waits for data"), "{errors}");

    let product = place.server();
    product.succeeded(job).await;
    assert_eq!(listings(&product).await["datasets"], before["datasets"]);
}
