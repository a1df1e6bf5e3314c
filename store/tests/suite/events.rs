use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use serde_json::json;
use store::{
    CheckpointFile, DeletionOrder, Event, EventFilter, EventKind, EventTail, JobId, Metric,
    NewCheckpoint, Page, Progress, Respect, Retry, Ripe, Store, object_path,
};

use super::{Fixture, LONG, assert_lost, pipeline, simulate, train};

/// Other tests' transactions in the same cluster of PostgreSQL may keep events from settling for a moment.
async fn tail(store: &Store) -> EventTail {
    for _ in 0..30 {
        if let Some(tail) = store.event_tail().await.unwrap() {
            return tail;
        }
    }
    panic!("no event settles");
}

/// Reads until `count` events have settled.
async fn settled(tail: &mut EventTail, count: usize) -> Vec<Event> {
    let mut events = Vec::new();
    for _ in 0..3000 {
        events.extend(tail.read().await.unwrap());
        if events.len() >= count {
            return events;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("{count} events were expected, and these settled: {events:?}");
}

/// All events in the store.
async fn all(store: &Store) -> Vec<Event> {
    store.events(&EventFilter::default(), 0, i64::MAX, 100_000).await.unwrap()
}

fn states(events: &[Event]) -> Vec<String> {
    let state = |event: &Event| match event.kind {
        EventKind::Job | EventKind::Task => {
            format!("{} {}", event.kind, event.data["state"].as_str().unwrap())
        }
        kind => kind.to_string(),
    };
    events.iter().map(state).collect()
}

pub async fn every_change_of_a_job_and_its_tasks_is_told_in_order(f: Fixture) {
    let mut tail = tail(&f.store).await;
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, "no room", Retry::Allowed).await.unwrap();
    let task = f.must_claim().await;
    f.store.complete(task.fence, None).await.unwrap();
    let events = settled(&mut tail, 7).await;
    let expected = [
        "job queued",
        "task running",
        "job running",
        "task queued",
        "task running",
        "task succeeded",
        "job succeeded",
    ];
    let mut found = states(&events);
    // A claim and the start of its job are one moment. Either event may come first.
    found[1..3].sort_by_key(|state| state.starts_with("job"));
    assert_eq!(found, expected);
    assert!(events.iter().all(|event| event.job == job));
    assert!(events.is_sorted_by(|a, b| a.id < b.id && a.at <= b.at));
    assert_eq!(events[0].data["name"], "train");
    let failed = &events[3].data;
    assert_eq!((&failed["task"], &failed["attempt"]), (&json!(task.fence.task), &json!(1)));
    assert_eq!(failed["error"], "no room (attempt 1 of 3)");
    assert_eq!(failed["worker"], "w1");
    assert_eq!(tail.read().await.unwrap(), []);
}

pub async fn metrics_and_checkpoints_are_told_once_for_each_write_and_heartbeats_never(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let before = all(&f.store).await.len();
    let metric = |step| Metric { key: "loss".to_owned(), step, value: 1.0 };
    f.store.record_metrics(task.fence, &[metric(3), metric(9), metric(5)]).await.unwrap();
    let progress = Progress { done: 4, ..Progress::default() };
    f.store.renew(task.fence, LONG, &progress).await.unwrap();
    let path = object_path::checkpoint(task.job, 9, task.fence.epoch, "config.json");
    let object = f.store.put_object(&path, "{}".into()).await.unwrap();
    let files = vec![CheckpointFile { name: "config.json".to_owned(), object }];
    let metrics = BTreeMap::new();
    let new = NewCheckpoint { step: 9, is_final: false, is_best: true, metrics, files };
    let checkpoint = f.store.commit_checkpoint(task.fence, &new).await.unwrap();
    let events = all(&f.store).await.split_off(before);
    assert_eq!(states(&events), ["metrics", "checkpoint"]);
    let run = task.run.unwrap();
    assert_eq!(events[0].data, json!({"run": run, "step": 9}));
    let expected = json!({
        "run": run, "checkpoint": checkpoint, "step": 9, "is_final": false, "is_best": true,
    });
    assert_eq!(events[1].data, expected);
}

pub async fn whatever_is_deleted_restored_or_purged_is_told(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let path = object_path::checkpoint(task.job, 9, task.fence.epoch, "config.json");
    let object = f.store.put_object(&path, "{}".into()).await.unwrap();
    let files = vec![CheckpointFile { name: "config.json".to_owned(), object }];
    let metrics = BTreeMap::new();
    let new = NewCheckpoint { step: 9, is_final: true, is_best: true, metrics, files };
    let checkpoint = f.store.commit_checkpoint(task.fence, &new).await.unwrap();
    f.store.complete(task.fence, None).await.unwrap();
    let run = task.run.unwrap();
    let mut before = all(&f.store).await.len();
    let mut told = async |change: &str| {
        let events = all(&f.store).await.split_off(before);
        before += events.len();
        assert!(events.iter().all(|event| event.kind == EventKind::Deletion && event.job == job));
        assert!(events.iter().all(|event| event.data["change"] == change), "{change}: {events:?}");
        let item = |event: &Event| {
            format!("{} {}", event.data["item"].as_str().unwrap(), event.data["item_id"])
        };
        events.iter().map(item).collect::<BTreeSet<String>>()
    };
    let whole: BTreeSet<String> =
        [format!("job {job}"), format!("run {run}"), format!("checkpoint {checkpoint}")].into();
    let order = DeletionOrder { respect: Respect::All, keep: LONG, reason: None };
    f.store.delete(checkpoint.into(), &order).await.unwrap();
    assert_eq!(told("deleted").await, [format!("checkpoint {checkpoint}")].into());
    f.store.restore(checkpoint.into()).await.unwrap();
    assert_eq!(told("restored").await, [format!("checkpoint {checkpoint}")].into());
    f.store.delete(job.into(), &order).await.unwrap();
    assert_eq!(told("deleted").await, whole);
    f.store.purge(Ripe::After(Duration::ZERO)).await.unwrap();
    assert_eq!(told("purged").await, whole);
}

pub async fn tasks_that_nobody_began_are_told_by_their_job(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    f.store.cancel(job).await.unwrap();
    let events = all(&f.store).await;
    let jobs: Vec<&str> =
        events.iter().map(|event| event.data["state"].as_str().unwrap()).collect();
    assert!(events.iter().all(|event| event.kind == EventKind::Job), "{events:?}");
    assert_eq!((jobs.first(), jobs.last()), (Some(&"queued"), Some(&"cancelled")));
    assert!(events.iter().any(|event| event.data["cancel_requested"] == true));
}

pub async fn a_write_that_changes_nothing_tells_nothing(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    f.store.release(task.fence).await.unwrap();
    let before = all(&f.store).await;
    assert_lost(f.store.fail(task.fence, "late", Retry::Never).await, task.fence);
    assert_lost(f.store.complete(task.fence, None).await, task.fence);
    let metric = Metric { key: "loss".to_owned(), step: 1, value: 1.0 };
    assert_lost(f.store.record_metrics(task.fence, &[metric]).await, task.fence);
    assert_eq!(all(&f.store).await, before);
}

pub async fn events_are_read_from_any_of_them_on(f: Fixture) {
    let one = f.submit_one(simulate(1)).await;
    let other = f.submit_one(simulate(2)).await;
    f.work_off().await;
    let events = all(&f.store).await;
    for (place, event) in events.iter().enumerate() {
        let filter = EventFilter::default();
        let rest = f.store.events(&filter, event.id, i64::MAX, 100_000).await.unwrap();
        assert_eq!(rest, events[place + 1..]);
        let next = f.store.events(&filter, event.id, i64::MAX, 1).await.unwrap();
        assert_eq!(next, rest[..rest.len().min(1)]);
        let until = f.store.events(&filter, 0, event.id, 100_000).await.unwrap();
        assert_eq!(until, events[..=place]);
    }
    for (jobs, kind) in
        [(Some([other]), None), (None, Some(EventKind::Task)), (Some([one]), Some(EventKind::Job))]
    {
        let filter = EventFilter { jobs: jobs.as_ref().map(|jobs| &jobs[..]), kind };
        let found = f.store.events(&filter, 0, i64::MAX, 100_000).await.unwrap();
        let fits = |event: &&Event| {
            jobs.is_none_or(|jobs| jobs.contains(&event.job))
                && kind.is_none_or(|wanted| wanted == event.kind)
        };
        let expected: Vec<Event> = events.iter().filter(fits).cloned().collect();
        assert!(!expected.is_empty());
        assert_eq!(found, expected);
    }
}

pub async fn a_tail_reads_each_event_once_however_many_write(f: Fixture) {
    let mut tail = tail(&f.store).await;
    let mut writers = Vec::new();
    for writer in 0..4 {
        let store = f.store.clone();
        writers.push(tokio::spawn(async move {
            for seed in 0..5 {
                store.submit(pipeline(writer * 100 + seed)).await.unwrap();
                let offers = spec::Resources::default();
                while let Some(task) = store.claim("w", &offers, LONG).await.unwrap() {
                    store.complete(task.fence, None).await.unwrap();
                }
            }
        }));
    }
    let mut read: Vec<Event> = Vec::new();
    while !writers.iter().all(tokio::task::JoinHandle::is_finished) {
        read.extend(tail.read().await.unwrap());
    }
    for writer in writers {
        writer.await.unwrap();
    }
    let written = all(&f.store).await;
    let missing = written.len() - read.len();
    if missing > 0 {
        read.extend(settled(&mut tail, missing).await);
    }
    assert!(read.is_sorted_by(|a, b| a.id < b.id), "in order, each once");
    assert_eq!(read.len(), written.len());
    assert_eq!(read, written);
    let ends = |job: JobId| {
        let of_job = |event: &&Event| event.kind == EventKind::Job && event.job == job;
        written.iter().rfind(of_job).map(|event| event.data["state"].clone())
    };
    for job in f.store.jobs(store::JobFilter::default(), Page::default()).await.unwrap() {
        assert_eq!(ends(job.id), Some(json!(job.state)), "the last event has the state");
    }
}

pub async fn old_events_are_forgotten_and_the_newest_stays(f: Fixture) {
    const DAY: Duration = Duration::from_secs(24 * 60 * 60);
    f.submit_one(simulate(1)).await;
    f.work_off().await;
    let events = all(&f.store).await;
    assert_eq!(f.store.forget_events(100_000, DAY).await.unwrap(), 0);
    assert_eq!(f.store.kept_events().await.unwrap().1, events.last().unwrap().id);
    f.store.forget_events(3, DAY).await.unwrap();
    assert_eq!(all(&f.store).await, events[events.len() - 3..]);
    assert_eq!(f.store.kept_events().await.unwrap().0, events[events.len() - 3].id);
    tokio::time::sleep(Duration::from_millis(20)).await;
    assert_eq!(f.store.forget_events(100_000, Duration::from_millis(5)).await.unwrap(), 2);
    let last = events.last().unwrap();
    assert_eq!(all(&f.store).await, std::slice::from_ref(last));
    f.store.forget_events(0, Duration::ZERO).await.unwrap();
    f.submit_one(simulate(2)).await;
    let ids: Vec<i64> = all(&f.store).await.iter().map(|event| event.id).collect();
    assert!(ids.len() > 1 && ids[0] == last.id && ids.is_sorted(), "no id is given twice: {ids:?}");
}
