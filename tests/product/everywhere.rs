//! The results are the same on every database, with any number of workers, and when servers and
//! workers are killed.

use std::cell::RefCell;
use std::process::{Child, Command, Stdio};

use serde_json::Value;
use tempfile::TempDir;
use testbed::{Cluster, TestDatabase};

use crate::pipeline::{Results, results};
use crate::product::{Product, member, signal, small_pipeline, torqued};
use crate::s3_server::S3Server;

/// Servers and workers that share a database, and a folder or a bucket for objects.
struct Lab {
    database: TestDatabase,
    /// With a bucket, each server and worker has a separate folder. Without one, all share the
    /// first.
    folders: RefCell<Vec<TempDir>>,
    bucket: Option<S3Server>,
}

impl Lab {
    fn with_a_folder() -> Self {
        let folders = RefCell::new(vec![tempfile::tempdir().unwrap()]);
        Self { database: Cluster::shared().database(), folders, bucket: None }
    }

    fn with_a_bucket() -> Self {
        Self { bucket: Some(S3Server::start()), ..Self::with_a_folder() }
    }

    fn server(&self, workers: &str) -> Product {
        let mut command = torqued(&["serve", "--listen", "127.0.0.1:0", "--worker-threads", "1"]);
        command.args(["--lease-seconds", "2", "--workers", workers]);
        Product::spawn(self.at_home(&mut command))
    }

    fn worker(&self) -> LoneWorker {
        let mut command = torqued(&["worker", "--threads", "1", "--lease-seconds", "2"]);
        LoneWorker(self.at_home(&mut command).stdout(Stdio::null()).spawn().unwrap())
    }

    fn at_home<'a>(&self, command: &'a mut Command) -> &'a mut Command {
        let mut folders = self.folders.borrow_mut();
        if let Some(bucket) = &self.bucket {
            folders.push(tempfile::tempdir().unwrap());
            command.env("TORQUED_OBJECTS", S3Server::url("arm").to_string());
            command.envs(bucket.variables());
        }
        let folder = folders.last().unwrap().path();
        command.arg("--data").arg(folder).env("TORQUED_DATABASE", self.database.url())
    }
}

/// A worker that no server started.
struct LoneWorker(Child);

impl Drop for LoneWorker {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The results of a pipeline on SQLite, by one worker.
async fn expected() -> Results {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&small_pipeline()).await;
    results(&product, &product.succeeded(id).await).await
}

async fn when_under_way(product: &Product, pipeline: i64, finished: usize) -> Value {
    let ended = |member: &&Value| member["state"] == "succeeded";
    product
        .job_when(pipeline, |job| {
            job["members"].as_array().unwrap().iter().filter(ended).count() >= finished
        })
        .await
}

/// Runs a pipeline on several workers and kills one in the middle. A single worker is replaced.
async fn with_a_worker_killed(lab: &Lab, workers: usize) -> (Product, Value) {
    let expected = expected().await;
    let server = lab.server("0");
    let mut working: Vec<LoneWorker> = (0..workers).map(|_| lab.worker()).collect();
    let id = server.submit(&small_pipeline()).await;
    when_under_way(&server, id, 1).await;
    drop(working.remove(0));
    if working.is_empty() {
        working.push(lab.worker());
    }
    let pipeline = server.succeeded(id).await;
    assert_eq!(results(&server, &pipeline).await, expected);
    (server, pipeline)
}

#[tokio::test]
async fn a_pipeline_on_postgresql_by_one_worker_that_is_killed_and_replaced() {
    with_a_worker_killed(&Lab::with_a_folder(), 1).await;
}

#[tokio::test]
async fn a_pipeline_on_postgresql_by_four_workers_of_which_one_is_killed() {
    with_a_worker_killed(&Lab::with_a_folder(), 4).await;
}

#[tokio::test]
async fn a_pipeline_in_a_bucket_by_one_worker_that_is_killed_and_replaced() {
    with_a_worker_killed(&Lab::with_a_bucket(), 1).await;
}

#[tokio::test]
async fn a_pipeline_in_a_bucket_by_four_workers_that_share_no_folder_of_which_one_is_killed() {
    let lab = Lab::with_a_bucket();
    let (_server, pipeline) = with_a_worker_killed(&lab, 4).await;
    // Another server without the file gives the bytes of the row's digest.
    let other = lab.server("0");
    let job = other.get(&format!("/v1/jobs/{}", member(&pipeline, "train"))).await;
    let checkpoint = job["checkpoints"].as_array().unwrap().last().unwrap().as_i64().unwrap();
    let listed = other.get(&format!("/v1/checkpoints/{checkpoint}")).await;
    let file =
        listed["files"].as_array().unwrap().iter().find(|file| file["name"] == "config.json");
    let name = file.unwrap()["name"].as_str().unwrap();
    let config = other.get(&format!("/v1/checkpoints/{checkpoint}/files/{name}")).await;
    assert!(config["model"].is_object(), "{config:#}");
}

#[tokio::test]
async fn two_servers_serve_one_queue_and_one_goes_on_when_the_other_is_killed() {
    let expected = expected().await;
    let lab = Lab::with_a_folder();
    let (first, second) = (lab.server("1"), lab.server("1"));
    let id = first.submit(&small_pipeline()).await;
    when_under_way(&second, id, 1).await;
    signal("KILL", first.pid());
    let pipeline = second.succeeded(id).await;
    assert_eq!(results(&second, &pipeline).await, expected);
    // Its worker ended with it and is recorded as dead.
    let workers = second.get("/v1/workers").await;
    assert!(!workers["workers"].as_array().unwrap().is_empty(), "{workers:#}");
    let (status, health) = second.try_get("/healthz").await;
    assert!(status.is_success(), "{health:#}");
}

#[tokio::test]
async fn a_database_that_is_not_there_is_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let database = Cluster::shared().database();
    let url = database.url().replace("/test_", "/no_such_");
    let mut command = torqued(&["serve", "--listen", "127.0.0.1:0", "--data"]);
    command.arg(folder.path()).env("TORQUED_DATABASE", url);
    let (code, _, errors) = crate::product::run_to_end(&mut command);
    assert_eq!(code, Some(1));
    assert!(errors.contains("create it first: createdb no_such_"), "{errors}");
    assert_eq!(errors.trim().lines().count(), 1, "{errors}");
}
