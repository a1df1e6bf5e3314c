//! The checkpoints that stored specs refer to, and their files.

use spec::{CheckpointRef, Digest, TrainingRef, TrainingStep};
use store::{Checkpoint, WhichCheckpoint};

use crate::attempt::Attempt;
use crate::error::TaskError;

/// A checkpoint that a spec refers to.
pub(crate) struct FoundCheckpoint {
    pub checkpoint: Checkpoint,
    /// The digest of its training's spec.
    pub training: Digest,
    /// How it differs from the final checkpoint, to be shown after a name: ` (best)`.
    pub mark: String,
}

/// Finds the checkpoint. Submission has replaced every other form of reference by a digest.
pub(crate) fn find(
    attempt: &Attempt,
    reference: &CheckpointRef,
) -> Result<FoundCheckpoint, TaskError> {
    let missing = |name: String| TaskError::Missing { what: "the checkpoint of training", name };
    let (digest, which, mark) = match reference {
        CheckpointRef::Digest(digest) => (*digest, WhichCheckpoint::Final, String::new()),
        CheckpointRef::Best(TrainingRef::Digest(digest)) => {
            (*digest, WhichCheckpoint::Best, " (best)".to_owned())
        }
        CheckpointRef::Step(TrainingStep { digest, step }) => {
            (*digest, WhichCheckpoint::Step(*step), format!(" (step {step})"))
        }
        CheckpointRef::Job(_)
        | CheckpointRef::Checkpoint(_)
        | CheckpointRef::Alias(_)
        | CheckpointRef::Best(TrainingRef::Job(_)) => {
            return Err(missing(format!("{reference:?}")));
        }
    };
    let found = attempt.wait(attempt.store.checkpoint_by_digest(digest, which))?;
    let checkpoint = found.ok_or_else(|| missing(format!("{digest}{mark}")))?;
    Ok(FoundCheckpoint { checkpoint, training: digest, mark })
}

/// The digest of the training that made a checkpoint. Submission has replaced other references.
pub(crate) fn training_of(reference: &CheckpointRef) -> Option<Digest> {
    match reference {
        CheckpointRef::Digest(digest)
        | CheckpointRef::Best(TrainingRef::Digest(digest))
        | CheckpointRef::Step(TrainingStep { digest, .. }) => Some(*digest),
        CheckpointRef::Job(_)
        | CheckpointRef::Checkpoint(_)
        | CheckpointRef::Alias(_)
        | CheckpointRef::Best(TrainingRef::Job(_)) => None,
    }
}

/// The bytes of a checkpoint's file.
pub(crate) fn read(
    attempt: &Attempt,
    checkpoint: &Checkpoint,
    name: &'static str,
) -> Result<Vec<u8>, TaskError> {
    let missing =
        || TaskError::Missing { what: "a file of the checkpoint:", name: name.to_owned() };
    let object = checkpoint.file(name).ok_or_else(missing)?;
    Ok(attempt.wait(attempt.store.read_object(object))?.to_vec())
}
