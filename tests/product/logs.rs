//! A task's log is stored, followed and downloaded, and commands end quietly when the reader of
//! their output ends.

use std::process::Stdio;

use serde_json::{Value, json};

use crate::product::{Product, run_to_end, small_pipeline, torqued};

fn training(steps: u32) -> Value {
    let mut spec = small_pipeline()["jobs"]["train"].clone();
    spec["data"] = json!({"stream": {"preset": "D1-multisine", "samples": 60}});
    spec["steps"] = steps.into();
    spec
}

fn logs(product: &Product, arguments: &[&str]) -> (Option<i32>, String, String) {
    run_to_end(torqued(&["logs", "--server", &product.url]).args(arguments))
}

#[tokio::test]
async fn a_training_is_followed_line_by_line_to_its_end() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&training(200)).await;
    let (code, output, errors) = logs(&product, &["-f", "--task", "train", &id.to_string()]);
    assert_eq!(code, Some(0), "{errors}");
    // A command that follows to the end ends after the job.
    assert_eq!(product.get(&format!("/v1/jobs/{id}")).await["state"], "succeeded");
    let job = product.get(&format!("/v1/jobs/{id}")).await;
    let digest = format!("digest={}", job["digest"].as_str().unwrap());
    let version = format!("version=\"{}\"", env!("CARGO_PKG_VERSION"));
    let lines = [
        "==> train, attempt 1 on worker-1 <==",
        "begins",
        &digest,
        &version,
        "threads=1",
        "device=cpu",
        "simulates its data",
        "trains from here step=0",
        "validated step=50",
        "kept a checkpoint",
        "step=200",
        "done seconds=",
    ];
    for line in lines {
        assert!(output.contains(line), "no {line:?} in\n{output}");
    }
    let (_, last, _) = logs(&product, &["--lines", "1", &id.to_string()]);
    assert!(last.lines().count() == 2 && last.contains("done seconds="), "{last}");
    let download = product.get("/v1/attempts/1/log").await;
    assert_eq!(output.split_once('\n').unwrap().1, download.as_str().unwrap());
    // Lines of the worker itself belong to no attempt.
    assert!(!output.contains("device works"), "{output}");
}

#[tokio::test]
async fn the_lines_of_a_killed_worker_are_there_and_the_next_goes_on() {
    let data = tempfile::tempdir().unwrap();
    // The log level of stderr does not matter.
    let product = Product::start_with(data.path(), &["--worker-threads", "1", "--log", "error"]);
    let id = product.submit(&training(1500)).await;
    let path = format!("/v1/jobs/{id}/logs?attempt=1");
    product.job_when(id, |job| job["progress"]["done"].as_f64() > Some(0.0)).await;
    let has_checkpoint = |page: &Value| page.to_string().contains("kept a checkpoint");
    product.when(&path, has_checkpoint).await;
    product.kill_worker().await;
    product.succeeded(id).await;
    let first = product.get("/v1/attempts/1/log").await;
    assert!(first.as_str().unwrap().contains("kept a checkpoint"), "{first}");
    let attempts = product.get(&format!("/v1/jobs/{id}/attempts")).await;
    let reason = attempts["attempts"][1]["reason"].as_str().unwrap();
    assert!(reason.contains("signal: 9"), "{reason}");
    let second = product.get("/v1/attempts/2/log").await;
    let second = second.as_str().unwrap();
    assert!(second.contains("trains from here") && !second.contains("step=0 "), "{second}");
    let (code, both, _) = logs(&product, &[&id.to_string()]);
    assert_eq!((code, both.matches("==> train").count()), (Some(0), 2), "{both}");
}

#[tokio::test]
async fn a_task_that_failed_says_why_and_its_worker_has_a_new_log_for_the_next() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let mut spec = training(1_000_000);
    spec["execution"] = json!({"time_limit_s": 1});
    let failed = product.submit(&spec).await;
    assert_eq!(product.finished(failed).await["state"], "failed");
    let next = product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    product.succeeded(next).await;
    let log = product.get("/v1/attempts/1/log").await;
    let log = log.as_str().unwrap();
    assert!(log.contains("the task is to end: it takes longer than its job allows"), "{log}");
    assert!(log.contains("not done"), "{log}");
    let log = product.get("/v1/attempts/2/log").await;
    let log = log.as_str().unwrap();
    assert_eq!(log.matches("begins").count(), 1, "{log}");
    assert!(log.contains("simulated and published") && !log.contains("not done"), "{log}");
}

#[tokio::test]
async fn what_cannot_be_asked_for_is_refused_in_a_line() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let id = product.submit(&training(10)).await.to_string();
    let (code, output, errors) = logs(&product, &[&id]);
    assert_eq!((code, output.as_str()), (Some(0), ""));
    assert!(errors.contains("nothing was logged yet"), "{errors}");
    for (arguments, words) in [
        (["9", "--lines", "5"], "there is no job 9"),
        (
            [id.as_str(), "--task", "shard"],
            "task is \"shard\", allowed: the label or the id of a task",
        ),
        ([id.as_str(), "--attempt", "7"], "attempt is \"7\""),
    ] {
        let (code, _, errors) = logs(&product, &arguments);
        assert_eq!(code, Some(1));
        assert!(errors.starts_with("error: ") && errors.contains(words), "{errors}");
    }
}

/// Caught: `torqued jobs | head` panicked.
#[tokio::test]
async fn a_command_whose_output_nobody_reads_ends_quietly() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let id = product.submit(&training(10)).await.to_string();
    let commands: [&[&str]; 6] = [
        &["jobs"],
        &["jobs", "--json"],
        &["attempts", &id],
        &["workers"],
        &["presets"],
        &["cancel", &id],
    ];
    for arguments in commands {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let mut command = torqued(arguments);
        command.args(["--server", &product.url]).stdout(writer).stderr(Stdio::piped());
        let ended = command.spawn().unwrap().wait_with_output().unwrap();
        let errors = String::from_utf8_lossy(&ended.stderr);
        assert_eq!((ended.status.code(), errors.as_ref()), (Some(141), ""), "{arguments:?}");
    }
}
