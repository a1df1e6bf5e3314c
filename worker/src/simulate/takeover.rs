//! Takes over a shard that another job with the same digest has made.

use std::ops::ControlFlow;

use store::{EarlierShard, FileContent, ShardContents, StoreError, StoredObject, object_path};

use crate::attempt::Attempt;
use crate::error::TaskError;

/// Commits the shard of an earlier job that failed or was cancelled, and breaks. Continues if there
/// is no such shard, or it is damaged.
pub(super) fn take_over(attempt: &Attempt) -> Result<ControlFlow<()>, TaskError> {
    let (store, task) = (&attempt.store, &attempt.task);
    let earlier = attempt.wait(store.earlier_shard(task.job, task.ordinal))?;
    let Some(EarlierShard { contents, result }) = earlier else {
        return Ok(ControlFlow::Continue(()));
    };
    let copied = copy(attempt, &contents, FileContent::Trajectories).and_then(|trajectories| {
        Ok((trajectories, copy(attempt, &contents, FileContent::Robots)?))
    });
    match copied {
        Ok((trajectories, robots)) => {
            let shard = ShardContents { trajectories, robots, ..contents };
            tracing::info!("takes over the shard of an earlier job");
            attempt.end(store.commit_shard(task.fence, &shard, result.as_ref()))?;
            Ok(ControlFlow::Break(()))
        }
        Err(error) if error.is_unusable_object() => {
            let error = spec::causes(&error);
            tracing::warn!(task = %task.label, error, "makes the shard anew");
            Ok(ControlFlow::Continue(()))
        }
        Err(error) => Err(error.into()),
    }
}

fn copy(
    attempt: &Attempt,
    earlier: &ShardContents,
    content: FileContent,
) -> Result<StoredObject, StoreError> {
    let task = &attempt.task;
    let path = object_path::shard(task.job, task.ordinal, task.fence.epoch, content);
    attempt.wait(attempt.store.copy_object(earlier.file(content), &path))
}
