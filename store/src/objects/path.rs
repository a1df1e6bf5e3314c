//! The paths of objects of each kind.

use spec::Digest;

use crate::{Epoch, FileContent, JobId, RunId};

/// Names the store that the objects beside it belong to.
pub(crate) const MARKER: &str = "store.json";

/// Names the store that is moving here.
pub(crate) const MOVE_MARKER: &str = "unfinished-move.json";

/// Whether an object marks the place and belongs to no store's data.
pub(crate) fn is_mark(path: &str) -> bool {
    path == MARKER || path == MOVE_MARKER
}

pub fn shard(job: JobId, ordinal: u32, epoch: Epoch, content: FileContent) -> String {
    format!("datasets/{job}/shard-{ordinal:05}-e{epoch}-{content}.parquet")
}

pub fn checkpoint(job: JobId, step: u64, epoch: Epoch, name: &str) -> String {
    format!("checkpoints/{job}/step-{step:08}-e{epoch}/{name}")
}

/// The end of the path of a [`description`].
const DESCRIPTION: &str = "-training.json";

/// The path of a checkpoint's description. It may be written again under the same lease, so its
/// digest is in its path.
pub fn description(job: JobId, step: u64, epoch: Epoch, run: RunId, digest: &Digest) -> String {
    checkpoint(job, step, epoch, &format!("run-{run}-{}{DESCRIPTION}", digest.short()))
}

/// The run of a [`description`], given the last part of its path.
pub fn described_run(name: &str) -> Option<RunId> {
    let (run, _) = name.strip_suffix(DESCRIPTION)?.strip_prefix("run-")?.split_once('-')?;
    run.parse().ok().map(RunId)
}

/// Whether a path is one of [`checkpoint`].
pub(crate) fn is_of_checkpoint(path: &str) -> bool {
    path.starts_with("checkpoints/")
}

/// The path of an artifact. It may be written again under the same lease, so its digest is in its
/// path.
pub fn artifact(run: RunId, epoch: Epoch, digest: &Digest, name: &str) -> String {
    format!("runs/{run}/{}-e{epoch}-{name}", digest.short())
}

/// The path of a table of a run. It is written only once under a lease, and its digest is not known
/// before the end.
pub fn table(run: RunId, epoch: Epoch, name: &str) -> String {
    format!("runs/{run}/table-e{epoch}-{name}")
}
