//! Where the objects of each kind lie.

use spec::Digest;

use crate::{Epoch, FileContent, JobId, RunId};

/// Says whose the objects beside it are.
pub(crate) const MARKER: &str = "store.json";

/// Says which store is moving here.
pub(crate) const MOVE_MARKER: &str = "unfinished-move.json";

/// Whether an object is about the place and none of a store's.
pub(crate) fn is_mark(path: &str) -> bool {
    path == MARKER || path == MOVE_MARKER
}

pub fn shard(job: JobId, ordinal: u32, epoch: Epoch, content: FileContent) -> String {
    format!("datasets/{job}/shard-{ordinal:05}-e{epoch}-{content}.parquet")
}

pub fn checkpoint(job: JobId, step: u64, epoch: Epoch, name: &str) -> String {
    format!("checkpoints/{job}/step-{step:08}-e{epoch}/{name}")
}

/// The last part of [`description`].
const DESCRIPTION: &str = "-training.json";

/// What a checkpoint is, which may be said again under the same lease, so its digest is in its path.
pub fn description(job: JobId, step: u64, epoch: Epoch, run: RunId, digest: &Digest) -> String {
    checkpoint(job, step, epoch, &format!("run-{run}-{}{DESCRIPTION}", digest.short()))
}

/// The run of a [`description`], of which this is the last part of the path.
pub fn described_run(name: &str) -> Option<RunId> {
    let (run, _) = name.strip_suffix(DESCRIPTION)?.strip_prefix("run-")?.split_once('-')?;
    run.parse().ok().map(RunId)
}

/// Whether a path is one of [`checkpoint`].
pub(crate) fn is_of_checkpoint(path: &str) -> bool {
    path.starts_with("checkpoints/")
}

/// An artifact may be written again under the same lease, so its digest is in its path.
pub fn artifact(run: RunId, epoch: Epoch, digest: &Digest, name: &str) -> String {
    format!("runs/{run}/{}-e{epoch}-{name}", digest.short())
}

/// A table of a run is written once under a lease, and its digest is known at its end only.
pub fn table(run: RunId, epoch: Epoch, name: &str) -> String {
    format!("runs/{run}/table-e{epoch}-{name}")
}
