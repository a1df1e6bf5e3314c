//! The way that another training of the same digest has gone already.

use store::{Checkpoint, CheckpointFile, NewCheckpoint, StoreError, object_path};

use crate::attempt::Attempt;
use crate::error::TaskError;

/// Copies the last checkpoint of an earlier training that failed or was cancelled, the best if that is another, and
/// the metrics up to there, unless this training has a checkpoint of its own. One that is damaged is passed over for
/// the one before.
pub(super) fn take_over(attempt: &Attempt) -> Result<(), TaskError> {
    let (store, task) = (&attempt.store, &attempt.task);
    if attempt.wait(store.latest_checkpoint(task.job))?.is_some() {
        return Ok(());
    }
    let mut earlier = attempt.wait(store.earlier_checkpoints(task.job))?;
    while let Some(last) = earlier.pop() {
        let best = earlier.iter().rfind(|checkpoint| checkpoint.is_best);
        match best.into_iter().chain([&last]).try_for_each(|it| copy(attempt, it)) {
            Ok(()) => {
                tracing::info!(job = %task.job, from = %last.job, step = last.step, "goes on with an earlier training");
                return Ok(());
            }
            Err(error) if error.is_unusable_object() => {
                let error = faults::causes(&error);
                tracing::warn!(job = %last.job, step = last.step, error, "passes over a checkpoint");
            }
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

/// Metrics first: a checkpoint never stands for steps whose metrics are lost.
fn copy(attempt: &Attempt, earlier: &Checkpoint) -> Result<(), StoreError> {
    let (store, task) = (&attempt.store, &attempt.task);
    let mut files = Vec::new();
    for CheckpointFile { name, object } in &earlier.files {
        let path = object_path::checkpoint(task.job, earlier.step, task.fence.epoch, name);
        let object = attempt.wait(store.copy_object(object, &path))?;
        files.push(CheckpointFile { name: name.clone(), object });
    }
    attempt.wait(store.take_over_metrics(task.fence, earlier.run, earlier.step))?;
    let checkpoint = NewCheckpoint {
        step: earlier.step,
        // Ending is up to this training.
        is_final: false,
        is_best: earlier.is_best,
        metrics: earlier.metrics.clone(),
        files,
    };
    attempt.wait(store.commit_checkpoint(task.fence, &checkpoint))?;
    Ok(())
}
