//! Jobs of tasks that do nothing. A task's payload is the time of its submission.

use std::time::Duration;

use serde_json::{Value, json};
use store::{Access, Location, NewJob, NewTask, Reuse, Store, StoreError, Submission};

use crate::{Outcome, now_us};

/// Number of simultaneous submissions, as from many clients of one server.
const CLIENTS: u32 = 8;

/// A job of `count` tasks.
pub async fn one_job(place: &Location, count: u32) -> Outcome<()> {
    let store = open(place).await?;
    submit(&store, nothing(count)).await?;
    store.close().await;
    Ok(())
}

/// `count` jobs of one task.
pub async fn many_jobs(place: &Location, count: u32) -> Outcome<()> {
    let store = open(place).await?;
    let mut clients = Vec::new();
    for client in 0..CLIENTS {
        let store = store.clone();
        let share = count / CLIENTS + u32::from(client < count % CLIENTS);
        clients.push(tokio::spawn(async move {
            for _ in 0..share {
                submit(&store, nothing(1)).await?;
            }
            Ok::<(), StoreError>(())
        }));
    }
    for client in clients {
        client.await??;
    }
    store.close().await;
    Ok(())
}

/// Submits `count` jobs of one task, one every `period`.
pub async fn every_so_often(place: &Location, count: u32, period: Duration) -> Outcome<()> {
    let store = open(place).await?;
    let mut ticks = tokio::time::interval(period);
    for _ in 0..count {
        ticks.tick().await;
        submit(&store, nothing(1)).await?;
    }
    store.close().await;
    Ok(())
}

async fn open(place: &Location) -> Result<Store, StoreError> {
    Store::open_at(place, Access::Server).await
}

pub async fn submit(store: &Store, job: NewJob) -> Result<(), StoreError> {
    let submission = Submission { reuse: Reuse::Never, ..Submission::of(job) };
    store.submit(submission).await.map(|_| ())
}

/// A job of `tasks` tasks that do nothing, with the present as the time of its submission.
pub fn nothing(tasks: u32) -> NewJob {
    let called_at = now_us();
    let spec = json!({"kind": "nothing", "called_at_us": called_at});
    let tasks = (0..tasks).map(|ordinal| task(ordinal, &json!(called_at))).collect();
    NewJob { tasks, ..NewJob::new("nothing", spec) }
}

fn task(ordinal: u32, payload: &Value) -> NewTask {
    NewTask {
        stage: 0,
        ordinal,
        label: format!("task {ordinal}"),
        payload: payload.clone(),
        total: 1,
    }
}
