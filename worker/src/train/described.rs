//! The description that a checkpoint carries, for readers who have only its files.

use serde_json::Value;
use store::{
    CheckpointDescription, CheckpointFile, CheckpointFileDescription, NewCheckpoint, StoreError,
    object_path,
};

use crate::attempt::Attempt;
use crate::simulate::VERSION;

/// Publishes the description of a checkpoint as one of its files.
pub(super) fn describe(
    attempt: &Attempt,
    checkpoint: &mut NewCheckpoint,
    result: Option<Value>,
) -> Result<(), StoreError> {
    let (store, task) = (&attempt.store, &attempt.task);
    let Some(run) = task.run else { return Ok(()) };
    // The execution changes no result, so the description leaves it out.
    let mut spec = task.spec.clone();
    if let Some(fields) = spec.as_object_mut() {
        fields.remove("execution");
    }
    let described = |file: &CheckpointFile| CheckpointFileDescription {
        name: file.name.clone(),
        size: file.object.size,
        sha256: file.object.sha256,
    };
    let description = CheckpointDescription {
        digest: task.digest,
        version: VERSION.to_owned(),
        step: checkpoint.step,
        is_final: checkpoint.is_final,
        is_best: checkpoint.is_best,
        metrics: checkpoint.metrics.clone(),
        result,
        files: checkpoint.files.iter().map(described).collect(),
        spec,
    };
    let json = description.to_json();
    let digest = spec::Digest::of(&json);
    let epoch = task.fence.epoch;
    let path = object_path::description(task.job, checkpoint.step, epoch, run, &digest);
    let object = attempt.wait(store.put_object(&path, json.into()))?;
    let name = CheckpointDescription::FILE_NAME.to_owned();
    checkpoint.files.push(CheckpointFile { name, object });
    Ok(())
}
