//! `torqued migrate`: a data folder moves to PostgreSQL and a bucket, and back.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use reqwest::StatusCode;
use serde_json::{Value, json};
use testbed::{Cluster, TestDatabase};

use crate::pipeline::{Results, results};
use crate::product::{PATIENCE, Product, member, run_to_end, small_pipeline, torqued};
use crate::s3_server::{Asked, BUCKET, Fault, S3Server};

/// A PostgreSQL with a bucket.
struct Lab {
    database: TestDatabase,
    bucket: S3Server,
}

impl Lab {
    fn start() -> Self {
        Self { database: Cluster::shared().database(), bucket: S3Server::start() }
    }

    /// A command that moves a folder to this lab, with a folder for copies.
    fn migrate_here(&self, from: &Path, to: &Path) -> Command {
        let mut command = torqued(&["migrate", "--data"]);
        command.arg(from).arg("--to-data").arg(to).envs(self.bucket.variables());
        command.env("TORQUED_TO_DATABASE", self.database.url());
        command.args(["--to-objects", &S3Server::url("arm").to_string()]);
        command
    }

    /// Makes this lab the store of a command.
    fn as_store<'a>(&self, command: &'a mut Command, folder: &Path) -> &'a mut Command {
        command.arg("--data").arg(folder).envs(self.bucket.variables());
        command.args(["--objects", &S3Server::url("arm").to_string()]);
        command.env("TORQUED_DATABASE", self.database.url())
    }

    fn serve(&self, folder: &Path) -> Command {
        let mut command = torqued(&["serve", "--listen", "127.0.0.1:0", "--worker-threads", "1"]);
        self.as_store(&mut command, folder);
        command
    }

    /// Lets the bucket accept some objects and then no more, and then kills the command.
    async fn kill_in_the_middle(&self, mut command: Command) {
        // Two probes, two marks and three objects. Answers without a body are not delayed.
        const TAKEN: usize = 7;
        self.bucket.fail(Asked::Put, [Fault::DripAnswer; TAKEN]);
        self.bucket.fail(Asked::Put, [Fault::Busy; 60]);
        let mut process = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let started = Instant::now();
        // The marks are the first two files.
        let copied = || files(&self.bucket.file("arm")) > 2;
        while self.bucket.count(Asked::Put) <= TAKEN || !copied() {
            assert!(started.elapsed() < PATIENCE && process.try_wait().unwrap().is_none());
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        process.kill().unwrap();
        process.wait().unwrap();
        // Requests without a key use up the remaining faults.
        let http = reqwest::Client::builder().no_proxy().build().unwrap();
        while self.bucket.faults_left(Asked::Put) > 0 {
            let url = format!("{}/{BUCKET}/nobody", self.bucket.endpoint());
            http.put(url).send().await.unwrap();
        }
    }
}

/// Number of files in a folder and its subfolders.
fn files(folder: &Path) -> usize {
    let entries =
        std::fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path());
    entries.map(|path| if path.is_dir() { files(&path) } else { 1 }).sum()
}

/// Runs a command that must succeed, and gives its output and its errors.
fn succeed(command: &mut Command) -> (String, String) {
    let (code, output, errors) = run_to_end(command);
    assert_eq!(code, Some(0), "{errors}");
    (output, errors)
}

/// The lists of everything on a server.
async fn listings(product: &Product) -> Vec<Value> {
    let mut listings = Vec::new();
    for list in ["jobs", "datasets", "checkpoints", "evaluations"] {
        listings.push(product.get(&format!("/v1/{list}")).await);
    }
    listings
}

/// The answers of a server about a pipeline that ran elsewhere, which the server must reuse.
async fn answers(product: &Product, id: i64) -> (Vec<Value>, Results) {
    let listings = listings(product).await;
    let pipeline = product.get(&format!("/v1/jobs/{id}")).await;
    let results = results(product, &pipeline).await;
    let (status, again) = product.post("/v1/jobs", small_pipeline().to_string()).await;
    assert_eq!((status, again["id"].as_i64()), (StatusCode::OK, Some(id)));
    (listings, results)
}

/// An evaluation that needs the files of a dataset and a checkpoint.
async fn evaluate_again(product: &Product, pipeline: i64) {
    let pipeline = product.get(&format!("/v1/jobs/{pipeline}")).await;
    let job = |name: &str| format!("/v1/jobs/{}", member(&pipeline, name));
    let (data, training) = (product.get(&job("test-grid")).await, product.get(&job("train")).await);
    let checkpoints = training["checkpoints"].as_array().unwrap();
    let spec = json!({
        "kind": "evaluate",
        "data": {"dataset": data["dataset"]},
        "checkpoints": [{"checkpoint": checkpoints.iter().filter_map(Value::as_i64).max()}],
        "context": 40,
        "bootstrap": {"resamples": 300},
    });
    let id = product.submit(&spec).await;
    product.succeeded(id).await;
}

#[tokio::test]
async fn a_data_folder_goes_on_in_postgresql_and_s3_and_back_with_the_same_listings_and_digests() {
    let folder = || tempfile::tempdir().unwrap();
    let (first, between, last) = (folder(), folder(), folder());
    let lab = Lab::start();
    let product = Product::start(first.path());
    let id = product.submit(&small_pipeline()).await;
    product.succeeded(id).await;
    let expected = answers(&product, id).await;

    let (code, _, errors) = run_to_end(&mut lab.migrate_here(first.path(), between.path()));
    assert_eq!(code, Some(1));
    assert!(errors.contains("is in use by another torqued server"), "{errors}");
    assert_eq!(product.end_by("TERM").0, Some(0));

    lab.kill_in_the_middle(lab.migrate_here(first.path(), between.path())).await;
    let (code, _, errors) = run_to_end(&mut lab.serve(between.path()));
    assert_eq!(code, Some(1));
    assert!(errors.contains("repeat `torqued migrate`"), "{errors}");
    assert_eq!(errors.trim().lines().count(), 1, "{errors}");

    let (said, shown) = succeed(&mut lab.migrate_here(first.path(), between.path()));
    assert!(said.contains("moved 5 jobs") && said.contains("copied before; "), "{said}");
    let how = format!("--data {} --database URL --objects s3://lab/arm", between.path().display());
    assert!(said.contains(&how), "{said}");
    assert!(shown.contains("files") && shown.contains("compare"), "{shown}");

    let product = Product::spawn(&mut lab.serve(between.path()));
    assert!(answers(&product, id).await == expected, "PostgreSQL and S3 answer otherwise");
    evaluate_again(&product, id).await;
    let expected = answers(&product, id).await;
    assert_eq!(product.end_by("TERM").0, Some(0));

    let mut back = torqued(&["migrate"]);
    lab.as_store(&mut back, between.path()).arg("--to-data").arg(last.path());
    succeed(&mut back);
    let product = Product::start(last.path());
    assert!(answers(&product, id).await == expected, "the folder answers otherwise");
}
