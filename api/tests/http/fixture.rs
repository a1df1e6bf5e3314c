//! A server with a store of its own, and a worker that completes tasks with invented results.

use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Duration;

use api::{App, Options};
use axum::Router;
use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, HOST, LOCATION};
use axum::http::{HeaderMap, Method, Request, StatusCode};
use axum::response::Response;
use bytes::Bytes;
use http_body_util::BodyExt;
use hyper::body::Body as _;
use serde_json::{Value, json};
use spec::{DataSpec, JobKind, JobSpec, Resources};
use store::{
    Access, CheckpointFile, ClaimedTask, FileContent, Metric, NewArtifact, NewCheckpoint,
    NewLogChunk, Retry, ShardContents, Store, object_path,
};
use tempfile::TempDir;
use tower::ServiceExt;
use wire::{EvaluationResult, Headline};

use crate::contract::Asked;
use crate::tables;

pub struct Server {
    pub store: Store,
    router: Router,
    dir: TempDir,
}

/// The address to which a redirect leads from a path.
pub fn followed(path: &str, location: &str) -> String {
    if location.contains("://") || location.starts_with('/') {
        return location.to_owned();
    }
    let (mut folder, _) = path.rsplit_once('/').unwrap();
    let mut rest = location.strip_prefix("./").unwrap_or(location);
    while let Some(above) = rest.strip_prefix("../") {
        (folder, _) = folder.rsplit_once('/').expect("a redirect above the root");
        rest = above;
    }
    format!("{folder}/{rest}")
}

/// A response that was read to its end.
#[derive(Debug)]
pub struct TestResponse {
    pub status: StatusCode,
    pub headers: HeaderMap,
    pub body: Bytes,
}

impl TestResponse {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }

    pub fn text(&self) -> &str {
        std::str::from_utf8(&self.body).unwrap()
    }

    pub fn header(&self, name: &str) -> &str {
        self.headers.get(name).unwrap_or_else(|| panic!("no {name}: {self:?}")).to_str().unwrap()
    }

    /// Checks that this is a problem of `status` and returns it.
    #[track_caller]
    pub fn problem(&self, status: u16) -> Value {
        assert_eq!(self.status.as_u16(), status, "{self:?}");
        assert_eq!(self.header("content-type"), "application/problem+json");
        let problem = self.json();
        assert_eq!(problem["status"], status);
        for member in ["type", "title", "detail"] {
            assert!(problem[member].as_str().is_some_and(|text| !text.is_empty()), "{problem}");
        }
        problem
    }
}

impl Server {
    pub async fn start() -> Self {
        Self::start_with(&Options::default()).await
    }

    /// A server on which the jobs of [`small_pipeline`] are done.
    pub async fn with_small_pipeline() -> Self {
        let server = Self::start().await;
        server.submitted(&small_pipeline()).await;
        server.work().await;
        server
    }

    pub async fn start_with(options: &Options) -> Self {
        Self::start_app(options, |app| app).await
    }

    /// A server whose app was changed by `prepare`.
    pub async fn start_app(options: &Options, prepare: impl FnOnce(App) -> App) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path(), Access::Server).await.unwrap();
        let router = api::router(prepare(App::new(store.clone(), options)));
        Self { store, router, dir }
    }

    /// The same store on a server with other options.
    pub fn restarted_with(self, options: &Options) -> Self {
        let router = api::router(App::new(self.store.clone(), options));
        Self { router, ..self }
    }

    /// The file of a stored object.
    pub fn object(&self, path: &str) -> std::path::PathBuf {
        self.dir.path().join("objects").join(path)
    }

    /// An answer whose body was not read.
    pub async fn answer(&self, request: Request<Body>) -> Response {
        self.router.clone().oneshot(request).await.unwrap()
    }

    /// An answer that matches the OpenAPI document. The request must match it too, if it was
    /// accepted.
    pub async fn send(&self, request: Request<Body>) -> TestResponse {
        let (parts, mut body) = request.into_parts();
        // Only a complete body is checked, because those of uploads may come slowly.
        let json = if body.size_hint().exact().is_some() {
            let bytes = body.collect().await.unwrap().to_bytes();
            body = Body::from(bytes.clone());
            Some(bytes)
        } else {
            None
        };
        let path = parts.uri.path().to_owned();
        let asked = Asked::new(&parts, json.as_deref());
        let response = self.answer(Request::from_parts(parts, body)).await;
        let (mut parts, body) = response.into_parts();
        if parts.status.is_redirection()
            && let Some(location) = parts.headers.get_mut(LOCATION)
        {
            *location = followed(&path, location.to_str().unwrap()).parse().unwrap();
        }
        let body = match parts.headers.get(CONTENT_TYPE) {
            Some(media_type) if media_type == "text/event-stream" => begun(body).await,
            _ => body.collect().await.unwrap().to_bytes(),
        };
        let answer = TestResponse { status: parts.status, headers: parts.headers, body };
        asked.check(&answer);
        answer
    }

    /// The status of a GET, and its body if it arrives completely.
    pub async fn download(&self, path: &str) -> (StatusCode, Result<Bytes, axum::Error>) {
        let request = Request::get(path).header(HOST, "127.0.0.1:7070");
        let request = request.body(Body::empty()).unwrap();
        let response = self.router.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        (parts.status, body.collect().await.map(|body| body.to_bytes()))
    }

    pub async fn request(
        &self,
        method: Method,
        path: &str,
        headers: &[(&str, &str)],
    ) -> TestResponse {
        let mut request = Request::builder().method(method).uri(path);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        if !headers.iter().any(|(name, _)| *name == "host") {
            request = request.header(HOST, "127.0.0.1:7070");
        }
        self.send(request.body(Body::empty()).unwrap()).await
    }

    pub async fn get(&self, path: &str) -> TestResponse {
        self.request(Method::GET, path, &[]).await
    }

    /// The JSON of a GET.
    pub async fn json(&self, path: &str) -> Value {
        let answer = self.get(path).await;
        assert_eq!(answer.status, StatusCode::OK, "{path}: {answer:?}");
        answer.json()
    }

    pub async fn post(&self, path: &str) -> TestResponse {
        self.request(Method::POST, path, &[]).await
    }

    pub async fn submit(&self, spec: &Value) -> TestResponse {
        self.submit_to("/v1/jobs", spec, &[]).await
    }

    pub async fn submit_to(
        &self,
        path: &str,
        spec: &Value,
        headers: &[(&str, &str)],
    ) -> TestResponse {
        let mut request = Request::post(path)
            .header(HOST, "127.0.0.1:7070")
            .header(CONTENT_TYPE, "application/json");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        self.send(request.body(Body::from(spec.to_string())).unwrap()).await
    }

    /// Submits `spec`, which must be new, and returns its job.
    pub async fn submitted(&self, spec: &Value) -> Value {
        let answer = self.submit(spec).await;
        assert_eq!(answer.status, StatusCode::CREATED, "{answer:?}");
        answer.json()
    }

    pub async fn claim(&self) -> Option<ClaimedTask> {
        let offers = Resources::default();
        self.store.claim("test-worker", &offers, Duration::from_secs(600)).await.unwrap()
    }

    /// Claims and completes all tasks.
    pub async fn work(&self) {
        while let Some(task) = self.claim().await {
            self.finish(&task).await;
        }
    }

    /// Fails the next task permanently.
    pub async fn fail_next(&self, error: &str) {
        let task = self.claim().await.unwrap();
        self.store.fail(task.fence, error, Retry::Never).await.unwrap();
    }

    /// Adds to the log of a claimed task.
    pub async fn log(&self, task: &ClaimedTask, position: u64, text: &str) {
        let chunk = NewLogChunk { position, text: text.to_owned() };
        self.store.append_log(task.fence, &[chunk]).await.unwrap();
    }

    pub async fn finish(&self, task: &ClaimedTask) {
        self.log(task, 0, "did it\n").await;
        match task.kind.parse().unwrap() {
            JobKind::Simulate => self.commit_shard(task).await,
            JobKind::Train => self.finish_training(task).await,
            JobKind::Evaluate => {
                let result = match task.stage {
                    1 => Some(self.write_report(task).await),
                    _ => None,
                };
                self.store.complete(task.fence, result.as_ref()).await.unwrap();
            }
            JobKind::Import => self.commit_import(task).await,
            JobKind::Verify => {
                let result = json!({"shard": task.ordinal, "dataset": 1, "bytes": "equal"});
                self.store.complete(task.fence, Some(&result)).await.unwrap();
            }
            _ => self.store.complete(task.fence, None).await.unwrap(),
        }
    }

    async fn commit_shard(&self, task: &ClaimedTask) {
        let data = data_of(task);
        let trajectories = data.simulation().unwrap().shard(task.ordinal.into());
        let shard = self.write_shard(task, &data, trajectories).await;
        let summary = tables::summary(&data, shard.count, shard.rejected).to_result();
        self.store.commit_shard(task.fence, &shard, Some(&summary)).await.unwrap();
    }

    /// Completes an import as if its file had at least 3 trajectories.
    async fn commit_import(&self, task: &ClaimedTask) {
        let data = data_of(task);
        let shard = self.write_shard(task, &data, 0..3).await;
        let mut result = tables::summary(&data, shard.count, 0).to_result();
        result["import"] = json!({
            "rows": 1700, "recordings": 5, "dropped_recordings": 2, "trajectories": 3,
            "dropped_samples": 37, "warnings": ["line 9 to line 99: column \"q3\" stays"],
        });
        self.store.commit_import(task.fence, &shard, &result).await.unwrap();
    }

    async fn write_shard(
        &self,
        task: &ClaimedTask,
        data: &DataSpec,
        trajectories: Range<u64>,
    ) -> ShardContents {
        let file = |content| tables::write(&self.store, task, data, trajectories.clone(), content);
        ShardContents {
            first: trajectories.start,
            count: trajectories.end - trajectories.start,
            rejected: if task.kind == JobKind::Simulate.as_str() { 3 } else { 0 },
            trajectories: file(FileContent::Trajectories).await,
            robots: file(FileContent::Robots).await,
        }
    }

    async fn finish_training(&self, task: &ClaimedTask) {
        self.train_to(task, task.total, true).await;
        self.store.complete(task.fence, None).await.unwrap();
    }

    /// Records metrics of every step, and a checkpoint at the last one.
    pub async fn train_to(&self, task: &ClaimedTask, steps: u64, is_final: bool) {
        #[expect(clippy::cast_precision_loss, reason = "a curve to look at")]
        let decay = |step: u64| (-(step as f64) / 30.0).exp();
        let metrics: Vec<Metric> = (0..steps)
            .flat_map(|step| {
                let wiggle = if step % 2 == 0 { 0.02 } else { -0.02 };
                let value = |key: &str, value: f64| Metric { key: key.to_owned(), step, value };
                let mut all = vec![
                    value("train/loss", 0.05 + decay(step) + wiggle),
                    value("train/learning_rate", 1e-3),
                ];
                if step % 10 == 9 {
                    all.push(value("validation/loss", 0.07 + decay(step)));
                    all.push(value("validation/rmse_deg", 1.5 + 6.0 * decay(step)));
                }
                all
            })
            .collect();
        self.store.record_metrics(task.fence, &metrics).await.unwrap();
        let metrics = BTreeMap::from([("validation/rmse_deg".to_owned(), 1.5)]);
        let files = Vec::new();
        let checkpoint = NewCheckpoint { step: steps, is_final, is_best: true, metrics, files };
        self.keep(task, checkpoint).await;
    }

    /// Commits a checkpoint with invented files.
    pub async fn keep(&self, task: &ClaimedTask, new: NewCheckpoint) {
        let mut files = Vec::new();
        for (name, size) in [("config.json", 300), ("model.safetensors", 5000)] {
            let path = object_path::checkpoint(task.job, new.step, task.fence.epoch, name);
            let object = self.store.put_object(&path, bytes_of(size, 7)).await.unwrap();
            files.push(CheckpointFile { name: name.to_owned(), object });
        }
        let checkpoint = NewCheckpoint { files, ..new };
        self.store.commit_checkpoint(task.fence, &checkpoint).await.unwrap();
    }

    /// Returns the result of the task.
    async fn write_report(&self, task: &ClaimedTask) -> Value {
        let artifacts = [
            ("report.json", "application/json", report().to_string()),
            (
                "rmse-multisine.svg",
                "image/svg+xml",
                "<svg xmlns='http://www.w3.org/2000/svg'/>".to_owned(),
            ),
            ("rmse-multisine.csv", "text/csv", "series,frequency\n".to_owned()),
        ];
        for (name, media_type, text) in artifacts {
            let artifact = NewArtifact { name, media_type, bytes: Bytes::from(text) };
            self.store.put_artifact(task.fence, artifact).await.unwrap();
        }
        let report = serde_json::from_value(report()).unwrap();
        serde_json::to_value(EvaluationResult { headline: Headline::of(&report) }).unwrap()
    }
}

/// The beginning of a stream of events, which may never end.
async fn begun(mut stream: Body) -> Bytes {
    const QUIET: Duration = Duration::from_millis(100);
    let mut text = Vec::new();
    while let Ok(Some(frame)) = tokio::time::timeout(QUIET, stream.frame()).await {
        text.extend_from_slice(&frame.unwrap().into_data().unwrap());
    }
    text.into()
}

/// The spec of the dataset that a task makes.
fn data_of(task: &ClaimedTask) -> DataSpec {
    let spec: JobSpec = serde_json::from_value(task.spec.clone()).unwrap();
    DataSpec::of(&spec).unwrap()
}

/// `size` bytes, which are different for each `seed`.
pub fn bytes_of(size: usize, seed: u8) -> Bytes {
    (0..size).map(|i| u8::try_from(i % 251).unwrap() ^ seed).collect()
}

/// A pipeline of simulations with 2 shards and 2 cells, a training of 100 steps and its evaluation.
pub fn small_pipeline() -> Value {
    json!({
        "kind": "pipeline",
        "name": "quickstart",
        "jobs": {
            "train-set": {
                "preset": "D1-multisine", "trajectories": 200, "shard_trajectories": 100,
            },
            "test-grid": {
                "preset": "grid-multisine", "trajectories": 20,
                "excitation": {"multisine": {"frequency_hz": {"grid": [0.15, 0.3]}}},
            },
            "train": {
                "kind": "train", "data": {"job": "train-set"},
                "model": {"preset": "robomorph-tiny"}, "batch_size": 32, "steps": 100,
            },
            "evaluate": {
                "kind": "evaluate", "data": {"job": "test-grid"},
                "checkpoints": [{"job": "train"}],
            },
        },
    })
}

/// A simulation of 10 robots in one shard.
pub fn small_simulation(seed: u64) -> Value {
    json!({"preset": "D1-multisine", "trajectories": 10, "seed": seed})
}

/// A training on the dataset that `data` refers to.
pub fn small_training(data: &Value) -> Value {
    json!({
        "kind": "train", "data": data, "steps": 20, "batch_size": 4,
        "model": {"preset": "robomorph-tiny"},
    })
}

pub fn report() -> Value {
    let rmse = |values: [f64; 4]| -> Value {
        let names = ["hold-last", "damped-integrator", "least-squares", "robomorph"];
        names
            .iter()
            .zip(values)
            .map(|(name, mean)| {
                json!({"predictor": name, "mean": mean, "low": mean * 0.93, "high": mean * 1.08})
            })
            .collect()
    };
    let paired = |group: &str, against: &str, mean: f64, half: f64| {
        json!({
            "group": group, "predictor": "robomorph", "against": against,
            "difference_deg": {"mean": mean, "low": mean - half, "high": mean + half},
        })
    };
    let cell = |frequency_hz: f64, in_distribution: bool, values: [f64; 4]| {
        json!({
            "family": "multisine", "frequency_hz": frequency_hz, "scenarios": 10,
            "in_distribution": in_distribution, "rmse_deg": rmse(values), "scores": [],
        })
    };
    json!({
        "context": 320, "horizon": 80, "rate_hz": 60.0,
        "bootstrap": {"resamples": 2000, "seed": 0}, "samples": 1,
        "predictors": [
            {"name": "hold-last", "kind": "baseline"},
            {"name": "damped-integrator", "kind": "baseline"},
            {"name": "least-squares", "kind": "baseline"},
            {"name": "robomorph", "kind": "checkpoint", "digest": "ab".repeat(32),
             "normalization": "context"},
        ],
        "in_distribution": [{"family": "multisine", "frequency_hz": [0.15, 0.15]}],
        "cells": [
            cell(0.15, true, [7.61, 1.52, 1.31, 1.18]),
            cell(0.3, false, [10.02, 3.21, 2.94, 3.87]),
        ],
        "groups": [
            {"name": "in distribution", "scenarios": 10, "scores": [],
             "rmse_deg": rmse([7.61, 1.52, 1.31, 1.18])},
            {"name": "out of distribution", "scenarios": 10, "scores": [],
             "rmse_deg": rmse([10.02, 3.21, 2.94, 3.87])},
        ],
        "failures": [], "worst": [],
        "paired": [
            paired("in distribution", "hold-last", -6.43, 0.4),
            paired("in distribution", "damped-integrator", -0.34, 0.12),
            paired("in distribution", "least-squares", -0.13, 0.2),
            paired("out of distribution", "hold-last", -6.15, 0.5),
            paired("out of distribution", "damped-integrator", 0.66, 0.3),
        ],
    })
}
