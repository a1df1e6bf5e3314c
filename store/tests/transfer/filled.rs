//! A store with rows in every table, and with values that databases store in different ways.

use std::time::Duration;

use bytes::Bytes;
use serde_json::json;
use spec::{Digest, Execution, Resources, RobotModel};
use store::{
    Access, AuditEntry, CheckpointFile, ClaimedTask, DeletionOrder, Idempotency, ItemKind,
    JobFilter, JobState, LabelChange, Metric, NewArtifact, NewCheckpoint, NewJob, NewLogChunk,
    NewRobot, NewTask, NewToken, NewTrackedRun, Output, Page, Progress, Respect, Retry, Reuse,
    Ripe, RobotSource, Scope, Store, Submission, TextChange, Timestamp, TrackedBatch,
    TrackedMetric, TrackedRunChange, object_path,
};
use tempfile::TempDir;

use super::sqlite;
use crate::suite::texts::UNUSUAL;
use crate::suite::workers::worker;
use crate::suite::{
    Fixture, alone, asking, beginning, files_of, import, pipeline, resources, simulate, task,
    train, verify,
};

/// A data folder with tasks in every state. The worker of the running task died.
pub async fn filled() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let store = Store::open(dir.path(), Access::Server).await.unwrap();
    let f = Fixture { store, objects: files_of(&dir), dir, keep: Box::new(()) };
    finished_pipeline(&f).await;
    purged_job(&f).await;
    failed_and_cancelled_jobs(&f).await;
    imported_file(&f).await;
    robots(&f).await;
    task_of_a_dead_worker(&f).await;
    jobs_to_do(&f).await;
    tokens_and_what_was_done_with_them(&f).await;
    tracked_run(&f).await;
    labels_of_everything(&f).await;
    deleted_things(&f).await;
    f.store.register_server("1.2.3").await.unwrap();
    f.store.check_database().await.unwrap();
    f.store.pause_queue().await.unwrap();
    f.store.close().await;
    let mut connection = sqlite(f.dir.path()).await;
    let long_ago = "UPDATE worker SET seen_at = seen_at - 3600000";
    sqlx::query(long_ago).execute(&mut connection).await.unwrap();
    f.dir
}

async fn finished_pipeline(f: &Fixture) {
    let asked = Idempotency { key: UNUSUAL.to_owned(), request: Digest::of(b"request") };
    f.submit(Submission { idempotency: Some(asked), ..pipeline(1) }).await;
    // This job exists already and becomes a member.
    f.submit(alone(simulate(1))).await;
    while let Some(task) = f.claim().await {
        if task.run.is_some() && task.stage == 0 {
            record(f, &task).await;
        }
        match task.kind.as_str() {
            "simulate" => {
                let shard = f.publish_shard(&task).await;
                f.store
                    .commit_shard(task.fence, &shard, Some(&json!({"left": 1e-300})))
                    .await
                    .unwrap();
            }
            _ => {
                let result = json!({"text": UNUSUAL, "numbers": [0.1, -0.0, 5e-324, 1e300, null]});
                f.store.complete(task.fence, Some(&result)).await.unwrap();
            }
        }
    }
}

/// Records metrics, a checkpoint and an artifact.
async fn record(f: &Fixture, task: &ClaimedTask) {
    let values = [0.1, -0.0, f64::NAN, f64::INFINITY, f64::MIN_POSITIVE, 1e300, 3.0];
    let mut metrics = Vec::new();
    for (step, value) in (1..).zip(values) {
        metrics.push(Metric { key: UNUSUAL.to_owned(), step, value });
    }
    // These need more than one statement.
    metrics.extend((1..=15_000_u32).map(|step| Metric {
        key: "loss".to_owned(),
        step: u64::from(step),
        value: 1.0 / f64::from(step),
    }));
    f.store.record_metrics(task.fence, &metrics).await.unwrap();
    let bytes = Bytes::from(UNUSUAL);
    let new = NewArtifact { name: "Länge $1.txt", media_type: "text/plain", bytes };
    f.store.put_artifact(task.fence, new).await.unwrap();
    let logged = NewLogChunk { position: 7, text: format!("{UNUSUAL}\n") };
    f.store.append_log(task.fence, &[logged]).await.unwrap();
    if task.kind != "train" {
        return;
    }
    for (step, is_final) in [(5, false), (10, true)] {
        let mut files = Vec::new();
        for name in ["model.safetensors", "config.json", "empty"] {
            let path = object_path::checkpoint(task.job, step, task.fence.epoch, name);
            let length = if name == "empty" { 0 } else { 700_000 };
            let bytes = Bytes::from(vec![b'x'; length]);
            let object = f.store.put_object(&path, bytes).await.unwrap();
            files.push(CheckpointFile { name: name.to_owned(), object });
        }
        let metrics = [("loss", 1e-300), ("Loss", -0.0), ("large", 1e16), ("third", 1.0 / 3.0)];
        let metrics = metrics.map(|(key, value)| (key.to_owned(), value)).into();
        let new = NewCheckpoint { step, is_final, is_best: is_final, metrics, files };
        f.store.commit_checkpoint(task.fence, &new).await.unwrap();
    }
}

/// It leaves the number of its attempts.
async fn purged_job(f: &Fixture) {
    let job = f.submit_one(simulate(9)).await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, "in vain", Retry::Never).await.unwrap();
    let order = DeletionOrder { respect: Respect::All, keep: Duration::ZERO, reason: None };
    f.store.delete(job.into(), &order).await.unwrap();
    f.store.purge(Ripe::After(Duration::ZERO)).await.unwrap();
}

async fn failed_and_cancelled_jobs(f: &Fixture) {
    f.submit_one(train(&simulate(2), vec![])).await;
    let released = f.must_claim().await;
    f.store.release(released.fence).await.unwrap();
    let failed = f.must_claim().await;
    f.store.fail(failed.fence, UNUSUAL, Retry::Never).await.unwrap();
    let cancelled = f.submit_one(simulate(3)).await;
    let running = f.must_claim().await;
    let shard = f.publish_shard(&running).await;
    f.store.commit_shard(running.fence, &shard, None).await.unwrap();
    f.store.cancel(cancelled).await.unwrap();
}

async fn imported_file(f: &Fixture) {
    let mut writer = f.store.begin_upload().await.unwrap();
    writer.write(&[7; 3_000_000]).await.unwrap();
    let file = writer.finish(UNUSUAL).await.unwrap();
    f.submit_one(import(file.object.sha256)).await;
    f.work_off().await;
}

/// One that was added with its URDF, and one that a job identified.
async fn robots(f: &Fixture) {
    let mut description = RobotModel::panda().description().clone();
    description.name = UNUSUAL.to_owned();
    let source = RobotSource { urdf: UNUSUAL.to_owned(), options: json!({"tip": UNUSUAL}) };
    let added = NewRobot {
        name: UNUSUAL.to_owned(),
        description: description.clone(),
        source: Some(source),
        doubts: vec![UNUSUAL.to_owned()],
        job: None,
        added_by: Some(UNUSUAL.to_owned()),
    };
    f.store.add_robot(&added).await.unwrap();
    description.joints[0].link.mass_kg = 1.0 / 3.0;
    let job = f.store.jobs(JobFilter::default(), Page::default()).await.unwrap()[0].id;
    let identified =
        NewRobot { description, source: None, job: Some(job), added_by: None, ..added };
    f.store.add_robot(&identified).await.unwrap();
}

async fn tokens_and_what_was_done_with_them(f: &Fixture) {
    let token = |name, lifetime| NewToken {
        name,
        digest: Digest::of(str::as_bytes(name)),
        scope: Scope::Admin,
        lifetime,
        needs_an_admin: true,
    };
    let lasting = f.store.create_token(&token("ana", None)).await.unwrap();
    f.store.token_used(lasting.id).await.unwrap();
    let hour = Some(Duration::from_secs(3600));
    let revoked = f.store.create_token(&token("ben", hour)).await.unwrap();
    f.store.revoke_token(revoked.id).await.unwrap();
    let text = || UNUSUAL.to_owned();
    let (actor, address, method, path) = (text(), text(), text(), text());
    let entry = AuditEntry { actor, address, method, path, status: 403, made: Some(text()) };
    f.store.record_audit(&entry).await.unwrap();
}

async fn labels_of_everything(f: &Fixture) {
    let page = Page::default();
    let job = f.store.jobs(JobFilter::default(), page).await.unwrap()[0].id.0;
    let run = f.store.runs(None, page).await.unwrap()[0].id.0;
    let dataset = f.store.datasets(None, page).await.unwrap()[0].id.0;
    let checkpoint = f.store.checkpoints(page).await.unwrap()[0].id.0;
    let text = || TextChange::Set(UNUSUAL.to_owned());
    let tags = Some(vec!["baseline".to_owned(), "sweep/3".to_owned()]);
    let change = LabelChange { name: text(), note: text(), tags, ..LabelChange::default() };
    for (item, id) in [
        (ItemKind::Job, job),
        (ItemKind::Run, run),
        (ItemKind::Dataset, dataset),
        (ItemKind::Checkpoint, checkpoint),
    ] {
        f.store.change_labels(item, id, &change).await.unwrap();
    }
    let add_aliases = vec!["champion".to_owned()];
    let change = LabelChange { add_aliases, ..LabelChange::default() };
    f.store.change_labels(ItemKind::Checkpoint, checkpoint, &change).await.unwrap();
}

/// Logs a run like a client of MLflow.
async fn tracked_run(f: &Fixture) {
    let tag = (UNUSUAL.to_owned(), UNUSUAL.to_owned());
    let tags = [tag];
    let experiment = f.store.create_experiment(UNUSUAL, &tags).await.unwrap();
    let new = NewTrackedRun {
        experiment,
        name: Some(UNUSUAL.to_owned()),
        user: UNUSUAL.to_owned(),
        start_time: Timestamp::from_milliseconds(i64::MAX),
        tags: tags.to_vec(),
    };
    let run = f.store.create_tracked_run(&new).await.unwrap();
    let values = [0.1, f64::NAN, f64::NEG_INFINITY, 1e300];
    let metric = |(step, value)| {
        let time = Timestamp::from_milliseconds(step);
        TrackedMetric { key: UNUSUAL.to_owned(), step, time, value }
    };
    let metrics = (1..).zip(values).map(metric).collect();
    let batch = TrackedBatch { metrics, params: tags.to_vec(), ..TrackedBatch::default() };
    f.store.log_batch(&run.identifier, &batch).await.unwrap();
    let mut writer = f.store.begin_tracked_artifact(&run).await.unwrap();
    writer.write(UNUSUAL.as_bytes()).await.unwrap();
    writer.finish_as_artifact(&run.identifier, "a/b.txt").await.unwrap();
    let end_time = Some(Timestamp::from_milliseconds(i64::MIN));
    let change = TrackedRunChange { end_time, ..TrackedRunChange::default() };
    f.store.change_tracked_run(&run.identifier, &change).await.unwrap();
}

/// Deletes and purges things. One job stays for those that read its data.
async fn deleted_things(f: &Fixture) {
    let order =
        |reason| DeletionOrder { respect: Respect::Open, keep: Duration::from_secs(3600), reason };
    let page = Page { before: None, limit: 500 };
    let jobs = f.store.jobs(JobFilter::default(), page).await.unwrap();
    let that = |kind: &str, state| jobs.iter().find(|job| job.kind == kind && job.state == state);
    let read = that("simulate", JobState::Succeeded).unwrap();
    let failed = that("train", JobState::Failed).unwrap();
    let early = f.store.checkpoints(page).await.unwrap().pop().unwrap();
    for item in [read.id.into(), failed.run.unwrap().into(), early.id.into()] {
        f.store.delete(item, &order(Some(UNUSUAL))).await.unwrap();
    }
    f.store.purge(Ripe::After(Duration::ZERO)).await.unwrap();
    f.store.delete(early.run.into(), &order(None)).await.unwrap();
    let new = NewTrackedRun {
        experiment: f.store.create_experiment("deleted", &[]).await.unwrap(),
        name: None,
        user: String::new(),
        start_time: Timestamp::from_milliseconds(0),
        tags: vec![],
    };
    f.store.create_tracked_run(&new).await.unwrap();
    f.store.set_experiment_deleted(new.experiment, Some(Duration::from_secs(3600))).await.unwrap();
}

async fn task_of_a_dead_worker(f: &Fixture) {
    let dead = worker("dead", 17);
    f.store.register_worker(&dead).await.unwrap();
    f.store.see_worker(&dead, Some(UNUSUAL)).await.unwrap();
    f.submit_one(simulate(5)).await;
    let offers = Resources::default();
    let task = f.store.claim("dead", &offers, Duration::ZERO).await.unwrap().unwrap();
    let message = Some(UNUSUAL.to_owned());
    let progress = Progress { done: 1, rate_per_second: Some(1.0 / 3.0), message };
    f.store.renew(task.fence, Duration::ZERO, &progress).await.unwrap();
    f.store.drain_worker("dead").await.unwrap();
}

async fn jobs_to_do(f: &Fixture) {
    let spec = json!({"tiny": 5e-324, "zero": -0.0, "text": UNUSUAL, "nothing": null});
    let tasks = (0..3000).map(|k| NewTask { label: format!("{UNUSUAL} {k}"), ..task(0, k, 1) });
    let new = NewJob {
        name: UNUSUAL.to_owned(),
        digest: Digest::of_json(&spec),
        spec,
        output: Output::Nothing,
        tasks: tasks.collect(),
        execution: Execution { time_limit_s: Some(3600), ..Execution::default() },
        ..simulate(4)
    };
    let asked = asking(new, resources(8, 1, &["a100", "lab-3"]));
    let now = f.store.now().await.unwrap();
    let job = f.submit_one(beginning(asked, now, 100)).await;
    f.submit_one(verify(job)).await;
    f.submit(Submission { reuse: Reuse::Never, ..pipeline(6) }).await;
    // This task is retried later.
    let task = f.must_claim().await;
    f.store.fail(task.fence, "a first time", Retry::Allowed).await.unwrap();
    tokio::time::sleep(Duration::from_millis(2)).await;
}
