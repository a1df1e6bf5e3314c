//! Submits jobs again, and completes them with the found objects.

use std::time::Duration;

use serde_json::Value;
use spec::{JobSpec, Resources};
use store::{ClaimedTask, Fence, JobId, Labels, Page, Reuse, RunId, Store, StoreError};

use super::work::{
    FoundJob, FoundObjects, FoundTraining, FoundWork, LeftOut, Rebuilt, ReindexError, refused,
};
use crate::kind::Limits;
use crate::submission::submit;
use crate::{SubmissionError, simulate::ShardTask};

/// The name of the worker in the rebuilt attempts.
const NAME: &str = "reindex";

/// The lease is long, because no other worker takes tasks meanwhile.
const LEASE: Duration = Duration::from_secs(24 * 60 * 60);

/// Writes the rows of the found objects into a database without jobs. No server and no worker may
/// use it meanwhile.
///
/// # Errors
/// When the database has jobs, or fails.
pub async fn rebuild(store: &Store, found: FoundObjects) -> Result<Rebuilt, ReindexError> {
    let newest = store.jobs(store::JobFilter::default(), Page { before: None, limit: 1 }).await?;
    if let Some(job) = newest.first() {
        return Err(ReindexError::HasJobs(job.id));
    }
    let FoundObjects { jobs, uploads, last_job, last_run, left_out } = found;
    let mut rebuilt = Rebuilt { left_out, ..Rebuilt::default() };
    for upload in &uploads {
        store.adopt_upload(upload).await?;
        rebuilt.uploads += 1;
    }
    // Tasks without a found object, until all others are completed.
    let mut missing = Vec::new();
    for (id, FoundJob { spec, work }) in jobs {
        let run = match &work {
            FoundWork::Training(training) => training.run.0 - 1,
            FoundWork::Shards(_) => 0,
        };
        store.skip_numbers(JobId(id.0 - 1), RunId(run)).await?;
        if let Err(reason) = submit_again(store, id, &spec).await? {
            let left_out = |path| LeftOut { path, reason: reason.clone() };
            rebuilt.left_out.extend(work.paths().into_iter().map(left_out));
            continue;
        }
        let before = missing.len();
        match work {
            FoundWork::Shards(mut shards) => {
                while let Some(task) = store.claim(NAME, &Resources::default(), LEASE).await? {
                    match shards.remove(&shard_of(&task)) {
                        Some(shard) if task.job == id => {
                            complete_shard(store, &task, &spec, &shard).await?;
                            rebuilt.shards += 1;
                        }
                        _ => missing.push(task.fence),
                    }
                }
                rebuilt.datasets += 1;
            }
            FoundWork::Training(training) => {
                let task = store.claim(NAME, &Resources::default(), LEASE).await?;
                let Some(task) = task.filter(|task| task.job == id) else {
                    let reason = "its training waits for data that is incomplete";
                    let work = FoundWork::Training(training);
                    let left_out = |path| LeftOut { path, reason: reason.to_owned() };
                    rebuilt.left_out.extend(work.paths().into_iter().map(left_out));
                    rebuilt.unfinished.push(id);
                    continue;
                };
                rebuilt.checkpoints += training.checkpoints.len() as u64;
                rebuilt.trainings += 1;
                missing.extend(complete_training(store, &task, &spec, &training).await?);
            }
        }
        if missing.len() > before {
            rebuilt.unfinished.push(id);
        }
    }
    for fence in missing {
        store.release(fence).await?;
    }
    store.skip_numbers(JobId(last_job), RunId(last_run)).await?;
    Ok(rebuilt)
}

/// Submits a job under its old id. Returns the reason if it is refused.
async fn submit_again(
    store: &Store,
    id: JobId,
    spec: &JobSpec,
) -> Result<Result<(), String>, ReindexError> {
    let limits = Limits { max_trajectories: u64::MAX, time_limits_s: [].into() };
    match submit(store, &limits, spec, Reuse::Never, None, Labels::default()).await {
        Ok(submitted) if submitted.job == id => Ok(Ok(())),
        Ok(submitted) => Err(ReindexError::OtherId { expected: id, found: submitted.job }),
        Err(SubmissionError::Store(error)) => Err(error.into()),
        Err(error) => Ok(Err(refused(&error))),
    }
}

/// The index of the shard that a task makes. An import has one shard.
fn shard_of(task: &ClaimedTask) -> u32 {
    serde_json::from_value(task.payload.clone()).map_or(task.ordinal, |ShardTask { shard }| shard)
}

async fn complete_shard(
    store: &Store,
    task: &ClaimedTask,
    spec: &JobSpec,
    shard: &store::ShardContents,
) -> Result<(), StoreError> {
    match spec {
        JobSpec::Import(_) => store.commit_import(task.fence, shard, &Value::Null).await,
        _ => store.commit_shard(task.fence, shard, None).await,
    }
}

/// Commits the checkpoints of a training. Returns its task if it had not ended.
async fn complete_training(
    store: &Store,
    task: &ClaimedTask,
    spec: &JobSpec,
    training: &FoundTraining,
) -> Result<Option<Fence>, StoreError> {
    let mut last = None;
    for checkpoint in training.checkpoints.values() {
        store.commit_checkpoint(task.fence, checkpoint).await?;
        last = Some(checkpoint);
    }
    let Some(last) = last.filter(|last| last.is_final) else { return Ok(Some(task.fence)) };
    let result = training.result.clone().unwrap_or_default();
    match spec {
        JobSpec::Train(spec) if last.step < spec.steps => {
            store.complete_early(task.fence, last.step, &result).await?;
        }
        _ => store.complete(task.fence, Some(&result)).await?,
    }
    Ok(None)
}
