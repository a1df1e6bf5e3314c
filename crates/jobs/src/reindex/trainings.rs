//! Rebuilds trainings. A file of each checkpoint names its training, its step and the digests of
//! its other files.

use std::collections::BTreeMap;

use serde_json::Value;
use spec::JobSpec;
use store::{
    CheckpointDescription, CheckpointFile, JobId, NewCheckpoint, RunId, Store, object_path,
};

use super::work::{FoundJob, FoundObjects, FoundTraining, FoundWork, Written, checked_spec};

/// Paths by the names of the files.
type Files = BTreeMap<String, String>;

/// A checkpoint that was read.
struct Read {
    spec: JobSpec,
    run: RunId,
    checkpoint: NewCheckpoint,
    result: Option<Value>,
}

pub(super) async fn read(
    store: &Store,
    checkpoints: BTreeMap<JobId, BTreeMap<Written, Files>>,
    found: &mut FoundObjects,
) {
    for (job, written) in checkpoints {
        let mut training: Option<(JobSpec, FoundTraining)> = None;
        // If a step was reached several times, the last time counts.
        for (Written { number: step, .. }, mut files) in written.into_iter().rev() {
            let paths: Vec<String> = files.values().cloned().collect();
            let known = training.as_ref();
            let read = match known {
                Some((_, training)) if training.checkpoints.contains_key(&step) => {
                    Err("another attempt wrote it again".to_owned())
                }
                _ => read_checkpoint(store, step, &mut files).await,
            };
            let read = match read {
                Ok(read) if known.is_some_and(|(spec, _)| *spec != read.spec) => {
                    Err("it is of another spec than other checkpoints of its job".to_owned())
                }
                read => read,
            };
            match read {
                Ok(Read { spec, run, mut checkpoint, result }) => {
                    let (_, training) = training.get_or_insert_with(|| {
                        let checkpoints = BTreeMap::new();
                        (spec, FoundTraining { run, checkpoints, result: None })
                    });
                    // The order is from last to first, because each best checkpoint replaced the
                    // one before.
                    let has_best =
                        training.checkpoints.values().any(|checkpoint| checkpoint.is_best);
                    checkpoint.is_best &= !has_best;
                    training.result = training.result.take().or(result);
                    training.checkpoints.insert(step, checkpoint);
                    let left = files.into_values();
                    left.for_each(|path| found.leave_out(path, "its checkpoint does not name it"));
                }
                Err(reason) => {
                    paths.into_iter().for_each(|path| found.leave_out(path, reason.clone()));
                }
            }
        }
        if let Some((spec, training)) = training {
            found.last_run = found.last_run.max(training.run.0);
            found.jobs.insert(job, FoundJob { spec, work: FoundWork::Training(training) });
        }
    }
}

/// Takes the files of a checkpoint out of `files`, or none if it is incomplete.
async fn read_checkpoint(store: &Store, step: u64, files: &mut Files) -> Result<Read, String> {
    let described = files.iter().filter_map(|(name, path)| {
        Some((object_path::described_run(name)?, name.clone(), path.clone()))
    });
    let described: Vec<(RunId, String, String)> = described.collect();
    if described.is_empty() {
        let file = CheckpointDescription::FILE_NAME;
        return Err(format!("its checkpoint has no {file}: an older torqued wrote it"));
    }
    // A checkpoint that became the last or the best was described a second time.
    let mut best: Option<(CheckpointDescription, RunId, String, CheckpointFile)> = None;
    for (run, name, path) in described {
        let object = store.find_object(&path).await.map_err(|error| error.to_string())?;
        let text = store.read_object(&object).await.map_err(|error| error.to_string())?;
        let description: CheckpointDescription = serde_json::from_slice(&text)
            .map_err(|error| format!("{path} is not a description: {error}"))?;
        let rank = |checkpoint: &CheckpointDescription| (checkpoint.is_final, checkpoint.is_best);
        if best.as_ref().is_none_or(|(other, ..)| rank(other) < rank(&description)) {
            let file = CheckpointDescription::FILE_NAME.to_owned();
            best = Some((description, run, name, CheckpointFile { name: file, object }));
        }
    }
    let Some((description, run, name, own_file)) = best else { return Err(String::new()) };
    if description.step != step {
        return Err(format!("it says step {}, and lies under step {step}", description.step));
    }
    let spec = checked_spec(description.spec.to_string().as_bytes(), description.digest)?;
    let mut taken = vec![name];
    let mut found = Vec::new();
    for file in &description.files {
        let path = files.get(&file.name);
        let path = path.ok_or_else(|| format!("its checkpoint lacks {}", file.name))?;
        let object = store.find_object(path).await.map_err(|error| error.to_string())?;
        if object.sha256 != file.sha256 {
            let (expected, found) = (file.sha256, object.sha256);
            return Err(format!(
                "checksum mismatch of {}: expected {expected}, found {found}",
                file.name
            ));
        }
        taken.push(file.name.clone());
        found.push(CheckpointFile { name: file.name.clone(), object });
    }
    taken.iter().for_each(|name| drop(files.remove(name)));
    found.push(own_file);
    let CheckpointDescription { is_final, is_best, metrics, result, .. } = description;
    let checkpoint = NewCheckpoint { step, is_final, is_best, metrics, files: found };
    Ok(Read { spec, run, checkpoint, result })
}
