//! The program under test: a server with its workers on a separate data folder.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use reqwest::StatusCode;
use serde_json::{Value, json};

/// A time limit for small work on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(180);

/// `torqued` with this test's arguments and an empty environment.
pub fn torqued(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_torqued"));
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("TORQUED_")) {
        command.env_remove(name);
    }
    command.args(arguments).stdin(Stdio::null());
    command
}

/// A running `torqued serve`.
pub struct Product {
    process: Child,
    pub url: String,
    http: reqwest::Client,
}

impl Product {
    /// Serves `data` on a free port with one worker. Its death is noticed soon.
    pub fn start(data: &Path) -> Self {
        Self::start_with(data, &["--worker-threads", "1", "--lease-seconds", "2"])
    }

    pub fn start_with(data: &Path, arguments: &[&str]) -> Self {
        let mut command = torqued(&["serve", "--listen", "127.0.0.1:0", "--data"]);
        Self::spawn(command.arg(data).args(arguments))
    }

    /// Runs a prepared `serve` and waits until it prints its address.
    pub fn spawn(command: &mut Command) -> Self {
        let mut process = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let url = line.split_whitespace().last().unwrap_or_default().to_owned();
        assert!(url.starts_with("http://"), "serve did not say where: {line:?}");
        let _ = rustls::crypto::ring::default_provider().install_default();
        // A command that a test waits for may take longer than the server keeps an idle connection.
        let http = reqwest::Client::builder().no_proxy().pool_max_idle_per_host(0).build().unwrap();
        Self { process, url, http }
    }

    pub fn pid(&self) -> u32 {
        self.process.id()
    }

    /// GET of a resource that must exist.
    pub async fn get(&self, path: &str) -> Value {
        let (status, body) = self.ask(self.http.get(self.address(path))).await;
        assert_eq!(status, StatusCode::OK, "GET {path}: {body}");
        body
    }

    /// GET of a resource that need not exist.
    pub async fn try_get(&self, path: &str) -> (StatusCode, Value) {
        self.ask(self.http.get(self.address(path))).await
    }

    /// The bytes of a file that must exist.
    pub async fn download(&self, path: &str) -> Vec<u8> {
        let response = self.http.get(self.address(path)).send().await.unwrap();
        assert_eq!(response.status(), StatusCode::OK, "GET {path}");
        response.bytes().await.unwrap().to_vec()
    }

    /// POST of a body without changes.
    pub async fn post(&self, path: &str, body: impl Into<String>) -> (StatusCode, Value) {
        let request = self.http.post(self.address(path)).header("content-type", "application/json");
        self.ask(request.body(body.into())).await
    }

    /// Submits a job that must be accepted; returns its id.
    pub async fn submit(&self, spec: &Value) -> i64 {
        let (status, job) = self.post("/v1/jobs", spec.to_string()).await;
        assert!(status.is_success(), "{status}: {job}");
        job["id"].as_i64().unwrap()
    }

    /// Waits for a job to end, and returns it.
    pub async fn finished(&self, job: i64) -> Value {
        self.job_when(job, |job| {
            ["succeeded", "failed", "cancelled"].contains(&job["state"].as_str().unwrap())
        })
        .await
    }

    /// Waits for a job to succeed, and returns it.
    pub async fn succeeded(&self, id: i64) -> Value {
        let job = self.finished(id).await;
        assert_eq!(job["state"], "succeeded", "{job:#}");
        job
    }

    /// Waits until a job fulfils a condition, and returns it.
    pub async fn job_when(&self, id: i64, reached: impl Fn(&Value) -> bool) -> Value {
        self.when(&format!("/v1/jobs/{id}"), reached).await
    }

    /// Waits until a job's only task fulfils a condition.
    pub async fn task_when(&self, job: i64, reached: impl Fn(&Value) -> bool) {
        self.when(&format!("/v1/jobs/{job}/tasks"), |tasks| reached(&tasks["tasks"][0])).await;
    }

    /// Waits until an answer fulfils a condition, and returns it.
    pub async fn when(&self, path: &str, reached: impl Fn(&Value) -> bool) -> Value {
        let started = Instant::now();
        loop {
            let answer = self.get(path).await;
            if reached(&answer) {
                return answer;
            }
            assert!(started.elapsed() < PATIENCE, "still waiting: {answer:#}");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    /// Waits until a worker has registered.
    pub async fn when_worker_is_there(&self) {
        self.when("/v1/workers", |answer| !answer["workers"].as_array().unwrap().is_empty()).await;
    }

    /// Process ids of this server's workers.
    pub fn workers(&self) -> Vec<u32> {
        children_of(self.pid())
    }

    /// Waits until there is a worker, and kills it with SIGKILL.
    pub async fn kill_worker(&self) {
        let started = Instant::now();
        loop {
            // A child that only tries the device may have ended since the list was read.
            if self.workers().first().is_some_and(|worker| sent("KILL", *worker)) {
                return;
            }
            assert!(started.elapsed() < PATIENCE, "no worker to kill");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }

    /// Sends a signal and waits for the end; returns the exit code and how long it took.
    pub fn end_by(mut self, name: &str) -> (Option<i32>, Duration) {
        let started = Instant::now();
        signal(name, self.pid());
        let status = self.process.wait().unwrap();
        (status.code(), started.elapsed())
    }

    fn address(&self, path: &str) -> String {
        format!("{}{path}", self.url)
    }

    async fn ask(&self, request: reqwest::RequestBuilder) -> (StatusCode, Value) {
        let response = request.send().await.unwrap();
        let status = response.status();
        let text = response.text().await.unwrap();
        (status, serde_json::from_str(&text).unwrap_or(Value::String(text)))
    }
}

impl Drop for Product {
    fn drop(&mut self) {
        // Its workers end when their standard input closes.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Sends a signal by its name.
pub fn signal(name: &str, pid: u32) {
    assert!(sent(name, pid), "kill -{name} {pid}");
}

/// Sends a signal, and tells whether the process existed.
fn sent(name: &str, pid: u32) -> bool {
    let command = format!("kill -{name} {pid}");
    Command::new("sh").args(["-c", &command]).status().unwrap().success()
}

/// Whether a process exists and is no zombie.
pub fn is_alive(pid: u32) -> bool {
    stat(pid).is_some_and(|(state, _)| state != 'Z')
}

/// Waits until a process is gone. The system kills it when its parent ends, but not at once.
pub async fn until_gone(pid: u32) {
    let started = Instant::now();
    while is_alive(pid) {
        assert!(started.elapsed() < Duration::from_secs(20), "process {pid} outlived its parent");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// The processes that a process has started and that are no zombies.
pub fn children_of(parent: u32) -> Vec<u32> {
    let entries = std::fs::read_dir("/proc").unwrap().flatten();
    entries
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .filter(|pid| stat(*pid).is_some_and(|(state, its)| its == parent && state != 'Z'))
        .collect()
}

/// State and parent of a process, from `/proc/PID/stat`: `PID (name) STATE PARENT ...`.
fn stat(pid: u32) -> Option<(char, u32)> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let mut fields = text.rsplit_once(')')?.1.split_whitespace();
    Some((fields.next()?.chars().next()?, fields.next()?.parse().ok()?))
}

/// Runs a command that must end by itself, and gives its exit code, standard output and standard
/// error.
pub fn run_to_end(command: &mut Command) -> (Option<i32>, String, String) {
    let mut process = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut stderr = process.stderr.take().unwrap();
    let errors = std::thread::spawn(move || {
        let mut text = String::new();
        stderr.read_to_string(&mut text).unwrap();
        text
    });
    let mut output = String::new();
    process.stdout.take().unwrap().read_to_string(&mut output).unwrap();
    let status = process.wait().unwrap();
    (status.code(), output, errors.join().unwrap())
}

/// Reports that a test cannot run here. `cargo xtask test` counts skipped tests.
pub fn skip(test: &str, reason: &str) {
    let line = format!("{test}: {reason}");
    eprintln!("SKIPPED {line}");
    if let Some(list) = std::env::var_os("SKIPPED_TESTS") {
        let mut list = std::fs::File::options().append(true).create(true).open(list).unwrap();
        writeln!(list, "{line}").unwrap();
    }
}

/// A pipeline with every kind of job, which takes seconds.
pub fn small_pipeline() -> Value {
    json!({
        "kind": "pipeline",
        "name": "small",
        "jobs": {
            "train-set": {
                "preset": "D1-multisine",
                "trajectories": 2000,
                "samples": 60,
                "shard_trajectories": 500,
            },
            "test-grid": {
                "preset": "grid-multisine",
                "trajectories": 60,
                "samples": 60,
                "excitation": {"multisine": {"frequency_hz": {"grid": [0.05, 0.15, 0.3]}}},
            },
            "train": {
                "kind": "train",
                "data": {"job": "train-set"},
                "context": 40,
                "model": {
                    "architecture": "robomorph", "d_model": 16, "heads": 2,
                    "encoder_layers": 1, "decoder_layers": 1, "patch": 5,
                },
                "batch_size": 16,
                "steps": 200,
                "validate_every_steps": 50,
                "checkpoint_every_steps": 20,
            },
            "evaluate": {
                "kind": "evaluate",
                "data": {"job": "test-grid"},
                "checkpoints": [{"job": "train"}],
                "context": 40,
                "bootstrap": {"resamples": 200},
            },
        },
    })
}

/// The id of a pipeline's member.
pub fn member(pipeline: &Value, name: &str) -> i64 {
    let members = pipeline["members"].as_array().unwrap();
    let member = members.iter().find(|member| member["name"] == name);
    member.unwrap_or_else(|| panic!("no {name} in {pipeline:#}"))["job"].as_i64().unwrap()
}
