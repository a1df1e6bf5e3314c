//! Work that ignores a request to end must end with its worker. Here it is an import whose decoder
//! is stopped, as on a disk that hangs.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use sqlx::{ConnectOptions, Connection};

use crate::product::{
    PATIENCE, Product, children_of, is_alive, run_to_end, signal, small_pipeline, torqued,
    until_gone,
};

/// Longer than the time between a cancellation and the end of its work, on a busy machine.
const SOON: Duration = Duration::from_secs(40);

/// Recordings that take seconds to decode.
const ROWS: usize = 1_000_000;

/// Submits the import of a large file, and stops its worker's decoder in the middle of it.
async fn stuck_import(
    product: &Product,
    folder: &Path,
    worker: impl Fn() -> Option<u32>,
    execution: &Value,
) -> (i64, u32) {
    let (file, spec) = (folder.join("long.csv"), folder.join("mapping.json"));
    let names = |prefix: &str| (1..=7).map(|k| format!("{prefix}{k}")).collect::<Vec<_>>();
    let (u, q) = (names("u"), names("q"));
    let row = ["0.1"; 14].join(",") + "\n";
    let mut csv = std::io::BufWriter::new(std::fs::File::create(&file).unwrap());
    writeln!(csv, "{},{}", u.join(","), q.join(",")).unwrap();
    (0..ROWS).for_each(|_| csv.write_all(row.as_bytes()).unwrap());
    csv.flush().unwrap();
    let mapping = json!({
        "columns": {"u": u, "q": q}, "samples": 100, "split": {"kind": "windows", "stride": 100},
        "execution": execution,
    });
    std::fs::write(&spec, mapping.to_string()).unwrap();
    let mut command = torqued(&["import", "--server", &product.url, "--spec"]);
    let (code, output, errors) = run_to_end(command.arg(spec).arg(file));
    assert_eq!(code, Some(0), "{errors}");
    let job = output.split_whitespace().nth(1).unwrap().parse().unwrap();
    let started = Instant::now();
    let decoder = loop {
        let children = worker().map(children_of).unwrap_or_default();
        if let Some(decoder) = children.into_iter().find(|pid| is_decoder(*pid)) {
            break decoder;
        }
        assert!(started.elapsed() < PATIENCE, "no decoder");
        tokio::time::sleep(Duration::from_millis(2)).await;
    };
    signal("STOP", decoder);
    (job, decoder)
}

/// Whether a process is a decoder that has limited its memory. It arranges to end with its worker
/// before that. A decoder that is stopped earlier would stay.
fn is_decoder(pid: u32) -> bool {
    let read = |what| std::fs::read(format!("/proc/{pid}/{what}")).unwrap_or_default();
    let (command, limits) = (read("cmdline"), read("limits"));
    let limits = String::from_utf8_lossy(&limits);
    let memory = limits.lines().find_map(|line| line.strip_prefix("Max data size"));
    String::from_utf8_lossy(&command).contains("decode-recording")
        && memory.is_some_and(|limit| !limit.trim_start().starts_with("unlimited"))
}

/// The log of the first attempt.
async fn log(product: &Product) -> String {
    product.get("/v1/attempts/1/log").await.as_str().unwrap().to_owned()
}

#[tokio::test]
async fn a_cancelled_task_that_does_not_end_ends_with_its_worker_and_another_goes_on() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let worker = || product.workers().first().copied();
    let (job, decoder) = stuck_import(&product, data.path(), worker, &json!({})).await;
    let worker = product.workers();
    let asked = Instant::now();
    product.post(&format!("/v1/jobs/{job}/cancel"), "").await;
    let ended = product.finished(job).await;
    assert_eq!(ended["state"], "cancelled", "{ended:#}");
    assert!(asked.elapsed() < SOON, "took {:?}", asked.elapsed());
    let attempts = product.get(&format!("/v1/jobs/{job}/attempts")).await["attempts"].clone();
    assert_eq!(
        (attempts.as_array().unwrap().len(), &attempts[0]["outcome"]),
        (1, &json!("cancelled"))
    );
    let log = log(&product).await;
    assert!(log.contains("did not end within 10 s, although its job was cancelled"), "{log}");

    let next = product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    product.succeeded(next).await;
    until_gone(decoder).await;
    assert!(!worker.iter().any(|pid| is_alive(*pid)));
}

#[tokio::test]
async fn a_task_that_takes_too_long_and_does_not_end_fails() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let worker = || product.workers().first().copied();
    let execution = json!({"time_limit_s": 2});
    let (job, decoder) = stuck_import(&product, data.path(), worker, &execution).await;
    let ended = product.finished(job).await;
    assert_eq!(ended["state"], "failed", "{ended:#}");
    let error = ended["error"].as_str().unwrap();
    assert!(error.contains("time limit of 2 s, and did not end within 30 s"), "{error}");
    let next = product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    product.succeeded(next).await;
    until_gone(decoder).await;
}

/// A worker without a server, and the file of its log.
fn worker_alone(data: &Path) -> (Child, PathBuf) {
    let log = data.join("worker.log");
    let mut command = torqued(&["worker", "--name", "alone", "--threads", "1", "--data"]);
    let errors = Stdio::from(std::fs::File::create(&log).unwrap());
    (command.arg(data).stderr(errors).spawn().unwrap(), log)
}

/// EX_TEMPFAIL of sysexits.h.
const GAVE_UP: Option<i32> = Some(75);

#[tokio::test]
async fn a_worker_that_is_told_to_stop_gives_back_a_task_that_does_not_end() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let (mut worker, log) = worker_alone(data.path());
    let pid = worker.id();
    let (job, decoder) = stuck_import(&product, data.path(), || Some(pid), &json!({})).await;
    signal("TERM", pid);
    assert_eq!(worker.wait().unwrap().code(), GAVE_UP);
    until_gone(decoder).await;
    let tasks = product.get(&format!("/v1/jobs/{job}/tasks")).await;
    let task = &tasks["tasks"][0];
    assert_eq!((&task["state"], &task["attempt"]), (&json!("queued"), &json!(0)), "{task:#}");
    assert_eq!(product.get("/v1/workers").await["workers"], json!([]));
    let log = std::fs::read_to_string(log).unwrap();
    assert!(log.contains("did not end within 20 s, although its worker was told to stop"), "{log}");
}

#[tokio::test]
async fn a_worker_whose_task_has_gone_to_another_ends_when_its_work_does_not() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let (mut worker, log) = worker_alone(data.path());
    let pid = worker.id();
    let (job, decoder) = stuck_import(&product, data.path(), || Some(pid), &json!({})).await;
    let file = data.path().join("torqued.sqlite");
    let mut connection =
        sqlx::sqlite::SqliteConnectOptions::new().filename(file).connect().await.unwrap();
    let claimed = "UPDATE task SET epoch = epoch + 1, worker = 'another', lease_ms = 3600000";
    sqlx::query(claimed).execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();
    assert_eq!(worker.wait().unwrap().code(), GAVE_UP);
    until_gone(decoder).await;
    let tasks = product.get(&format!("/v1/jobs/{job}/tasks")).await;
    let task = &tasks["tasks"][0];
    assert_eq!(
        (&task["state"], &task["worker"]),
        (&json!("running"), &json!("another")),
        "{task:#}"
    );
    let log = std::fs::read_to_string(log).unwrap();
    assert!(log.contains("did not end within 10 s, although its lease is lost"), "{log}");
}
