//! A server on loopback with checkpoints of a few thousand parameters.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use api::App;
use live::{LOADED_BYTES, Live};
use models::{CONFIG_FILE, Device, DeviceKind, MODEL_FILE, TrainedModel};
use reqwest::StatusCode;
use safetensors::SafeTensors;
use serde_json::{Value, json};
use spec::Resources;
use store::{Access, CheckpointFile, CheckpointId, NewCheckpoint, Store, object_path};
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

pub const JOINTS: usize = 7;

/// Context length of all checkpoints here except those of RoboMorph.
pub const CONTEXT: usize = 16;
pub const HORIZON: usize = 8;

pub struct Server {
    pub address: SocketAddr,
    pub http: reqwest::Client,
    store: Store,
    stop: Option<oneshot::Sender<()>>,
    serving: JoinHandle<Result<(), api::ServeError>>,
    folder: TempDir,
}

/// The folder of PyTorch twins: checkpoints with random weights, at least one of each architecture.
fn twins_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/tests/data")
}

/// The names of all twins.
pub fn twins() -> Vec<String> {
    let names = std::fs::read_dir(twins_folder()).unwrap().map(|entry| entry.unwrap().file_name());
    names.map(|name| name.into_string().unwrap()).collect()
}

fn twin(name: &str, file: &str) -> Vec<u8> {
    std::fs::read(twins_folder().join(name).join(file)).unwrap()
}

/// The model of a checkpoint that [`Server::checkpoint`] makes.
pub fn model(architecture: &str) -> TrainedModel {
    let (weights, config) = (twin(architecture, MODEL_FILE), twin(architecture, CONFIG_FILE));
    TrainedModel::load(&weights, &config, &Device::cpu()).unwrap()
}

impl Server {
    pub async fn start() -> Self {
        Self::start_with(&api::Options::default(), LOADED_BYTES).await
    }

    pub async fn start_with(options: &api::Options, loaded_bytes: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), Access::Server).await.unwrap();
        let threads = NonZero::new(2).unwrap();
        let live = live::Options { device: DeviceKind::Cpu, threads, loaded_bytes };
        let live = Live::new(store.clone(), live).unwrap();
        let app = App::new(store.clone(), options).with_models(Arc::new(live));
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let (stop, stopped) = oneshot::channel();
        let serving = tokio::spawn(api::serve(listener, app, async {
            let _ = stopped.await;
        }));
        let _ = rustls::crypto::ring::default_provider().install_default();
        let http = reqwest::Client::builder().no_proxy().build().unwrap();
        Self { address, http, store, stop: Some(stop), serving, folder }
    }

    /// A checkpoint with the weights of a twin.
    pub async fn checkpoint(&self, architecture: &str) -> i64 {
        self.keep(&twin(architecture, MODEL_FILE), &twin(architecture, CONFIG_FILE)).await
    }

    /// A checkpoint with weights so large that no prediction is a number.
    pub async fn exploded_checkpoint(&self, architecture: &str) -> i64 {
        let mut weights = twin(architecture, MODEL_FILE);
        let sizes: usize = SafeTensors::deserialize(&weights)
            .unwrap()
            .iter()
            .map(|(_, tensor)| tensor.data().len())
            .sum();
        let header = weights.len() - sizes;
        for number in weights[header..].as_chunks_mut::<4>().0 {
            *number = (f32::from_le_bytes(*number) * 1e30).to_le_bytes();
        }
        self.keep(&weights, &twin(architecture, CONFIG_FILE)).await
    }

    /// A checkpoint with a normalization that needs the future.
    pub async fn leaky_checkpoint(&self, architecture: &str) -> i64 {
        let mut config: Value = serde_json::from_slice(&twin(architecture, CONFIG_FILE)).unwrap();
        config["normalizer"] = json!("paper-leaky");
        self.keep(&twin(architecture, MODEL_FILE), config.to_string().as_bytes()).await
    }

    /// A checkpoint that records the ranges of its training: `u_nm` and `y_rad` of each joint,
    /// rates within 100 rad/s, and joints limited to ±`limit_rad`.
    pub async fn checkpoint_of_ranges(
        &self,
        architecture: &str,
        u_nm: [f64; 2],
        y_rad: [f64; 2],
        limit_rad: f64,
    ) -> i64 {
        let mut config: Value = serde_json::from_slice(&twin(architecture, CONFIG_FILE)).unwrap();
        config["ranges"] = json!({
            "u_nm": ([u_nm; JOINTS]), "y_rad": ([y_rad; JOINTS]),
            "rate_rad_s": ([[-100.0, 100.0]; JOINTS]),
        });
        config["limits_rad"] = json!(([[-limit_rad, limit_rad]; JOINTS]));
        self.keep(&twin(architecture, MODEL_FILE), config.to_string().as_bytes()).await
    }

    /// Commits files as the checkpoint of a training of their own.
    pub async fn keep(&self, weights: &[u8], config: &[u8]) -> i64 {
        let trainings = self.store.checkpoints(store::Page { before: None, limit: 100 }).await;
        let spec = json!({
            "kind": "train", "data": {"stream": {"preset": "D1-multisine"}}, "steps": 1,
            "batch_size": 4, "model": {"preset": "robomorph-tiny"},
            "optimizer": {"warmup_steps": 0}, "seed": trainings.unwrap().len(),
        });
        let (status, job) = self.post("/v1/jobs", &spec).await;
        assert_eq!(status, StatusCode::CREATED, "{job}");
        let ttl = Duration::from_secs(600);
        let task = self.store.claim("test", &Resources::default(), ttl).await.unwrap().unwrap();
        let mut files = Vec::new();
        for (name, bytes) in [(MODEL_FILE, weights), (CONFIG_FILE, config)] {
            let path = object_path::checkpoint(task.job, 1, task.fence.epoch, name);
            let object = self.store.put_object(&path, bytes.to_vec().into()).await.unwrap();
            files.push(CheckpointFile { name: name.to_owned(), object });
        }
        let metrics = BTreeMap::new();
        let new = NewCheckpoint { step: 1, is_final: true, is_best: false, metrics, files };
        let id = self.store.commit_checkpoint(task.fence, &new).await.unwrap();
        self.store.complete(task.fence, None).await.unwrap();
        id.0
    }

    /// Changes a byte in the middle of a file of a checkpoint.
    pub async fn damage(&self, checkpoint: i64, file: &str) {
        let checkpoint = self.store.checkpoint(CheckpointId(checkpoint)).await.unwrap();
        let path = &checkpoint.file(file).unwrap().path;
        let path = self.folder.path().join("objects").join(path);
        let mut bytes = std::fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(path, bytes).unwrap();
    }

    pub async fn post(&self, path: &str, body: &Value) -> (StatusCode, Value) {
        let request = self.http.post(format!("http://{}{path}", self.address));
        let request = request.header("content-type", "application/json").body(body.to_string());
        let answer = request.send().await.unwrap();
        let status = answer.status();
        (status, serde_json::from_str(&answer.text().await.unwrap()).unwrap())
    }

    pub async fn predict(&self, checkpoint: i64, question: &Value) -> (StatusCode, Value) {
        self.post(&format!("/v1/checkpoints/{checkpoint}/predict"), question).await
    }

    /// Asks a running server to stop.
    pub fn begin_to_stop(&mut self) {
        self.stop.take().unwrap().send(()).unwrap();
    }

    /// Waits until the server has stopped.
    pub async fn stopped(self) {
        self.serving.await.unwrap().unwrap();
    }
}

/// Rows of shape `[count][7]` with a different value at every place.
pub fn rows(count: usize, scale: f32) -> Vec<[f32; JOINTS]> {
    let value = |row: usize, joint: usize| scale * ((row * JOINTS + joint) as f32 * 0.37).sin();
    (0..count).map(|row| std::array::from_fn(|joint| value(row, joint))).collect()
}

/// A robot that moves, in a request's format.
pub fn scenario(scale: f32) -> Value {
    scenario_of(CONTEXT, HORIZON, scale)
}

pub fn scenario_of(context: usize, horizon: usize, scale: f32) -> Value {
    let u = rows(context + horizon, 3.0 * scale);
    json!({"u": u[..context], "y": rows(context, scale), "future_u": u[context..]})
}

/// The numbers of nested arrays, in order.
pub fn numbers(value: &Value) -> Vec<f32> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        #[expect(clippy::cast_possible_truncation, reason = "positions are f32")]
        number => vec![number.as_f64().unwrap() as f32],
    }
}

/// The fields of a problem's violations.
pub fn fields(problem: &Value) -> Vec<&str> {
    let violations = problem["violations"].as_array().unwrap();
    violations.iter().map(|violation| violation["field"].as_str().unwrap()).collect()
}
