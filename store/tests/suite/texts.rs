//! Texts of users and specs come back unchanged, and in the same order in every locale of the
//! database.

use bytes::Bytes;
use serde_json::json;
use spec::Digest;
use store::{
    CheckpointFile, Metric, NewArtifact, NewCheckpoint, NewJob, Progress, Retry, object_path,
};

use super::{Fixture, LONG, simulate, task, train};

/// Letters of many scripts, quotes, parameter marks, and a text that looks like an escape.
pub const UNUSUAL: &str = "Länge «λ» 腕 🦾 'quoted' \"twice\" $1 ? % \\u0000 \n\ttabbed";

pub async fn an_unusual_name_comes_back(f: Fixture) {
    let job = f.submit_one(NewJob { name: UNUSUAL.to_owned(), ..simulate(1) }).await;
    assert_eq!(f.store.job(job).await.unwrap().name, UNUSUAL);
}

pub async fn an_unusual_error_comes_back(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, UNUSUAL, Retry::Never).await.unwrap();
    assert_eq!(f.store.task(task.fence.task).await.unwrap().error.as_deref(), Some(UNUSUAL));
    assert_eq!(f.error(job).await, format!("piece 0.0: {UNUSUAL}"));
}

pub async fn an_unusual_message_comes_back(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let sent = Progress { done: 3, rate_per_second: Some(0.25), message: Some(UNUSUAL.to_owned()) };
    f.store.renew(task.fence, LONG, &sent).await.unwrap();
    assert_eq!(f.store.task(task.fence.task).await.unwrap().progress, sent);
}

pub async fn a_spec_keeps_every_digit_and_sign(f: Fixture) {
    let spec = json!({
        "tiny": 5e-324, "large": 1.797_693_134_862_315_7e308, "third": 1.0 / 3.0,
        "zero": -0.0, "integer": 9_007_199_254_740_991_u64, "text": UNUSUAL, "nothing": null,
        "nested": [[], {}, [true, false]],
    });
    let new = NewJob { digest: Digest::of_json(&spec), spec: spec.clone(), ..simulate(1) };
    let job = f.submit_one(new).await;
    let found = f.store.job(job).await.unwrap().spec;
    assert_eq!(found.to_string(), spec.to_string());
    assert_eq!(f.must_claim().await.spec.to_string(), spec.to_string());
}

pub async fn a_payload_and_a_result_keep_every_digit(f: Fixture) {
    let value = json!({"a": [0.1, 1e-300, "é", {"b": null}], "text": UNUSUAL});
    let mut job = train(&simulate(1), vec![]);
    job.tasks[0].payload = value.clone();
    f.submit_one(job).await;
    let task = f.must_claim().await;
    assert_eq!(task.payload.to_string(), value.to_string());
    f.store.complete(task.fence, Some(&value)).await.unwrap();
    let result = f.store.task(task.fence.task).await.unwrap().result;
    assert_eq!(result.map(|found| found.to_string()), Some(value.to_string()));
}

pub async fn a_large_result_comes_back(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let values: Vec<f64> = (0..100_000_u32).map(|k| f64::from(k).sqrt()).collect();
    f.store.complete(task.fence, Some(&json!(values))).await.unwrap();
    let result = f.store.task(task.fence.task).await.unwrap().result.unwrap();
    assert_eq!(result.as_array().map(Vec::len), Some(100_000));
    assert_eq!(result[99_999], json!(values[99_999]));
}

/// Upper case comes before lower case, and both come before accents, because bytes are compared.
const IN_ORDER: [&str; 6] = ["B", "Z-a", "a", "a b", "a_b", "ä"];

pub async fn keys_of_metrics_come_in_the_order_of_their_bytes(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let metric = |key: &&str| Metric { key: (*key).to_owned(), step: 1, value: 1.0 };
    let metrics: Vec<Metric> = IN_ORDER.iter().rev().map(metric).collect();
    f.store.record_metrics(task.fence, &metrics).await.unwrap();
    let latest = f.store.latest_metrics(&[task.run.unwrap()]).await.unwrap();
    assert_eq!(latest.iter().map(|(_, key, _)| key.as_str()).collect::<Vec<_>>(), IN_ORDER);
}

pub async fn artifacts_come_in_the_order_of_their_bytes(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    for name in IN_ORDER.iter().rev() {
        let bytes = Bytes::from((*name).to_owned());
        let new = NewArtifact { name, media_type: "text/plain", bytes };
        f.store.put_artifact(task.fence, new).await.unwrap();
    }
    let run = task.run.unwrap();
    let found = f.store.artifacts(&[run]).await.unwrap();
    assert_eq!(found.iter().map(|artifact| artifact.name.as_str()).collect::<Vec<_>>(), IN_ORDER);
    let named = f.store.artifacts_named(&[run], "a_b").await.unwrap();
    assert_eq!(named.iter().map(|artifact| artifact.run).collect::<Vec<_>>(), [run]);
}

pub async fn files_of_a_checkpoint_come_in_the_order_of_their_bytes(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let mut files = Vec::new();
    for name in ["b.json", "a.json", "C.json"] {
        let path = object_path::checkpoint(task.job, 1, task.fence.epoch, name);
        let object = f.store.put_object(&path, Bytes::from_static(b"{}")).await.unwrap();
        files.push(CheckpointFile { name: name.to_owned(), object });
    }
    let metrics = [("loss".to_owned(), 0.1), ("Loss".to_owned(), 1e-300)].into();
    let new = NewCheckpoint { step: 1, is_final: false, is_best: true, metrics, files };
    let id = f.store.commit_checkpoint(task.fence, &new).await.unwrap();
    let found = f.store.checkpoint(id).await.unwrap();
    let names: Vec<_> = found.files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(names, ["C.json", "a.json", "b.json"]);
    assert_eq!(found.metrics, new.metrics);
    let ids = f.store.checkpoint_ids(&[task.job]).await.unwrap();
    assert_eq!(ids, [(task.job, id)]);
}

pub async fn many_tasks_keep_their_labels_and_order(f: Fixture) {
    let tasks = (0..3000).map(|k| store::NewTask {
        label: format!("{UNUSUAL} {k}"),
        payload: json!({"k": k, "text": UNUSUAL}),
        ..task(k / 1000, k % 1000, 1)
    });
    let job = f.submit_one(NewJob { tasks: tasks.collect(), ..simulate(1) }).await;
    let found = f.store.tasks(job).await.unwrap();
    let is_right = |(k, task): (usize, &store::Task)| {
        task.label == format!("{UNUSUAL} {k}") && task.payload["k"] == k
    };
    assert!(found.len() == 3000 && found.iter().enumerate().all(is_right));
}
