//! Takes over checkpoints of another training with the same digest.

use models::Trainer;
use store::{
    Checkpoint, CheckpointDescription, CheckpointFile, NewCheckpoint, Retry, StoreError,
    object_path,
};

use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::train::described::describe;

/// Copies the last checkpoint of an earlier training that failed or was cancelled, its best
/// checkpoint if that is another one, and the metrics up to there. Does nothing if this training
/// has a checkpoint of its own. If a checkpoint is damaged, or `resume` finds that another version
/// of torqued wrote it, the one before is tried.
pub(super) fn take_over(
    attempt: &Attempt,
    resume: impl Fn(&Checkpoint) -> Result<Trainer, TaskError>,
) -> Result<(), TaskError> {
    let (store, task) = (&attempt.store, &attempt.task);
    if attempt.wait(store.latest_checkpoint(task.job))?.is_some() {
        return Ok(());
    }
    let mut earlier = attempt.wait(store.earlier_checkpoints(task.job))?;
    while let Some(last) = earlier.pop() {
        match resume(&last) {
            Ok(_) => {}
            Err(TaskError::Store(error)) if error.is_unusable_object() => {
                pass_over(&last, &error);
                continue;
            }
            Err(error) if error.retry() == Retry::Never => {
                pass_over(&last, &error);
                continue;
            }
            Err(error) => return Err(error),
        }
        if let Some(best) = earlier.iter().rfind(|checkpoint| checkpoint.is_best) {
            match copy(attempt, best) {
                Ok(()) => {}
                Err(error) if error.is_unusable_object() => pass_over(best, &error),
                Err(error) => return Err(error.into()),
            }
        }
        match copy(attempt, &last) {
            Ok(()) => {
                tracing::info!(job = %task.job, from = %last.job, step = last.step, "goes on with an earlier training");
                return Ok(());
            }
            Err(error) if error.is_unusable_object() => pass_over(&last, &error),
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

fn pass_over(checkpoint: &Checkpoint, reason: &dyn std::error::Error) {
    let Checkpoint { job, step, .. } = checkpoint;
    tracing::warn!(%job, step, reason = spec::causes(reason), "passes over a checkpoint");
}

/// Copies metrics first: a checkpoint never stands for steps whose metrics are lost.
fn copy(attempt: &Attempt, earlier: &Checkpoint) -> Result<(), StoreError> {
    let (store, task) = (&attempt.store, &attempt.task);
    let mut files = Vec::new();
    let described = |file: &&CheckpointFile| file.name == CheckpointDescription::FILE_NAME;
    for CheckpointFile { name, object } in earlier.files.iter().filter(|file| !described(file)) {
        let path = object_path::checkpoint(task.job, earlier.step, task.fence.epoch, name);
        let object = attempt.wait(store.copy_object(object, &path))?;
        files.push(CheckpointFile { name: name.clone(), object });
    }
    attempt.wait(store.take_over_metrics(task.fence, earlier.run, earlier.step))?;
    let mut checkpoint = NewCheckpoint {
        step: earlier.step,
        // Only this training decides about its end.
        is_final: false,
        is_best: earlier.is_best,
        metrics: earlier.metrics.clone(),
        files,
    };
    describe(attempt, &mut checkpoint, None)?;
    attempt.wait(store.commit_checkpoint(task.fence, &checkpoint))?;
    Ok(())
}
