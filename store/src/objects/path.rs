//! The paths of objects of each kind, and the reader that tells them from the names of others.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use spec::Digest;

use crate::{Epoch, FileContent, JobId, RunId, TrackedRunId};

/// Names the store that the objects beside it belong to.
pub(crate) const MARKER: &str = "store.json";

/// Names the store that is moving here.
pub(crate) const MOVE_MARKER: &str = "unfinished-move.json";

/// Whether an object marks the place and belongs to no store's data.
pub(crate) fn is_mark(path: &str) -> bool {
    path == MARKER || path == MOVE_MARKER
}

/// The beginning of the paths of uploads, which [`unique_name`] completes.
pub(crate) const UPLOAD: &str = "uploads/upload";

/// The beginnings of the paths of objects that only test the object store.
pub(crate) const PROBE_OBJECT: &str = "probe/object";
pub(crate) const PROBE_CLOCK: &str = "probe/clock";

/// The beginning of the paths of a tracked run's files.
pub(crate) fn tracked_artifact(run: TrackedRunId) -> String {
    format!("tracked/{run}/artifact")
}

/// The path of a file of a shard. An attempt with another epoch writes another file.
pub fn shard(job: JobId, ordinal: u32, epoch: Epoch, content: FileContent) -> String {
    format!("datasets/{job}/shard-{ordinal:05}-e{epoch}-{content}.parquet")
}

/// The path of a file of a checkpoint. An attempt with another epoch writes another file.
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

/// The kind of an object, read from its path. A store deletes nothing else from its place: a file with
/// another name was made by somebody else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MadeObject {
    Shard,
    CheckpointFile,
    RunFile,
    Upload,
    TrackedArtifact,
    Probe,
}

impl MadeObject {
    /// Reads a path. `None` for a path that no function of this file gives.
    pub fn of_path(path: &str) -> Option<Self> {
        if is_unique_name(UPLOAD, path) {
            return Some(Self::Upload);
        }
        if is_unique_name(PROBE_OBJECT, path) || is_unique_name(PROBE_CLOCK, path) {
            return Some(Self::Probe);
        }
        let parts: Vec<&str> = path.split('/').collect();
        match parts[..] {
            ["datasets", job, name] => is_shard(path, job, name).then_some(Self::Shard),
            ["checkpoints", job, step, name] => {
                is_checkpoint_file(path, job, step, name).then_some(Self::CheckpointFile)
            }
            ["runs", run, name] => is_run_file(run, name).then_some(Self::RunFile),
            ["tracked", run, _] => {
                let prefix = tracked_artifact(TrackedRunId(number(run)?));
                is_unique_name(&prefix, path).then_some(Self::TrackedArtifact)
            }
            _ => None,
        }
    }
}

/// Whether a path is that of an object, or of a mark, on its way into a folder: `PATH#N`.
pub(crate) fn is_unfinished(path: &str) -> bool {
    let Some((finished, count)) = path.rsplit_once('#') else { return false };
    let is_count = !count.is_empty() && count.bytes().all(|byte| byte.is_ascii_digit());
    is_count && (is_mark(finished) || MadeObject::of_path(finished).is_some())
}

fn is_shard(path: &str, job: &str, name: &str) -> bool {
    let read = || {
        let mut parts = name.strip_prefix("shard-")?.strip_suffix(".parquet")?.splitn(3, '-');
        let ordinal = parts.next()?.parse().ok()?;
        let epoch = Epoch(number(parts.next()?.strip_prefix('e')?)?);
        let content = parts.next()?;
        let content = FileContent::ALL.into_iter().find(|known| known.as_str() == content)?;
        Some(shard(JobId(number(job)?), ordinal, epoch, content))
    };
    read().is_some_and(|written| written == path)
}

fn is_checkpoint_file(path: &str, job: &str, step: &str, name: &str) -> bool {
    let read = || {
        let (step, epoch) = step.strip_prefix("step-")?.split_once("-e")?;
        let (step, epoch) = (step.parse().ok()?, Epoch(number(epoch)?));
        Some(checkpoint(JobId(number(job)?), step, epoch, name))
    };
    !name.is_empty() && read().is_some_and(|written| written == path)
}

/// Whether it is the path of an [`artifact`] or a [`table`].
fn is_run_file(run: &str, name: &str) -> bool {
    let read = || {
        number(run)?;
        let (first, rest) = name.split_once("-e")?;
        let (epoch, name) = rest.split_once('-')?;
        number(epoch)?;
        let is_digest = first.len() == SHORT_DIGEST
            && first.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
        Some((is_digest || first == "table") && !name.is_empty())
    };
    read().unwrap_or(false)
}

/// Number of hexadecimal digits of [`Digest::short`].
const SHORT_DIGEST: usize = 12;

/// Reads an id as it is written in paths: digits without zeros before them.
fn number(text: &str) -> Option<i64> {
    let number: i64 = text.parse().ok()?;
    (number >= 0 && number.to_string() == text).then_some(number)
}

/// A name that no other file of any process has.
pub(crate) fn unique_name(prefix: &str) -> String {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    format!("{prefix}-{:x}-{:x}-{count:x}", since_1970.as_nanos(), std::process::id())
}

/// Whether [`unique_name`] could have given `name` for this prefix.
pub(crate) fn is_unique_name(prefix: &str, name: &str) -> bool {
    let rest = name.strip_prefix(prefix).and_then(|rest| rest.strip_prefix('-'));
    let Some(rest) = rest else { return false };
    let is_number = |part: &str| {
        !part.is_empty() && part.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
    };
    rest.split('-').count() == 3 && rest.split('-').all(is_number)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made() -> Vec<(String, MadeObject)> {
        let (job, run, epoch) = (JobId(17), RunId(4), Epoch(12));
        let digest = Digest::of(b"x");
        let mut made = vec![
            (checkpoint(job, 2_000, epoch, "model.safetensors"), MadeObject::CheckpointFile),
            (checkpoint(job, 123_456_789, epoch, "config.json"), MadeObject::CheckpointFile),
            (description(job, 5, epoch, run, &digest), MadeObject::CheckpointFile),
            (artifact(run, epoch, &digest, "report.json"), MadeObject::RunFile),
            (artifact(run, epoch, &digest, "a-e5-b c.csv"), MadeObject::RunFile),
            (table(run, epoch, "scenarios.parquet"), MadeObject::RunFile),
            (unique_name(UPLOAD), MadeObject::Upload),
            (unique_name(PROBE_OBJECT), MadeObject::Probe),
            (unique_name(PROBE_CLOCK), MadeObject::Probe),
            (unique_name(&tracked_artifact(TrackedRunId(3))), MadeObject::TrackedArtifact),
        ];
        for content in FileContent::ALL {
            made.push((shard(job, 7, epoch, content), MadeObject::Shard));
            made.push((shard(job, 123_456, epoch, content), MadeObject::Shard));
        }
        made
    }

    #[test]
    fn every_path_that_is_written_is_read_again() {
        for (path, kind) in made() {
            assert_eq!(MadeObject::of_path(&path), Some(kind), "{path}");
            assert!(is_unfinished(&format!("{path}#0")), "{path}");
            assert!(!is_unfinished(&path), "{path}");
        }
        assert!(is_unfinished("store.json#1"));
    }

    #[test]
    fn names_of_others_are_not_taken_for_objects() {
        for path in [
            "ball.obj",
            "meshes/link1.stl",
            "store.json",
            "thesis/store.json",
            "datasets/panda/shard-00000-e1-robots.parquet",
            "datasets/1/shard-0-e1-robots.parquet",
            "datasets/1/shard-00000-e1-notes.parquet",
            "datasets/01/shard-00000-e1-robots.parquet",
            "datasets/1/shard-00000-e1-robots.parquet.bak",
            "datasets/1/readme.md",
            "datasets/1/more/shard-00000-e1-robots.parquet",
            "lab/datasets/1/shard-00000-e1-robots.parquet",
            "checkpoints/7/step-5-e1/model.safetensors",
            "checkpoints/7/step-00000005/model.safetensors",
            "checkpoints/7/step-00000005-e1/",
            "checkpoints/resnet/step-00000005-e1/model.safetensors",
            "runs/1/events.out.tfevents",
            "runs/2026-11-26/table-e1-a.parquet",
            "runs/1/0123456789ab-report.json",
            "runs/1/0123456789AB-e1-report.json",
            "uploads/upload-1",
            "uploads/lost",
            "uploads/upload-zz-1-0",
            "tracked/x/artifact-1-2-3",
            "tracked/1/plot-1-2-3",
            "probe/object",
        ] {
            assert_eq!(MadeObject::of_path(path), None, "{path}");
        }
        for path in ["paper.tex#1", "#notes#", "datasets/1/#0", "objects#1", "store.json#"] {
            assert!(!is_unfinished(path), "{path}");
        }
    }
}
