//! Warnings about a spec that was accepted.

use serde_json::Value;
use spec::{DataSource, DataSpec, JobSpec, Referred};
use store::{JobState, Store, StoreError};

use crate::kind::{MemoryDoubts, kind};

/// Sentences about the values of a stored spec, those of a pipeline's jobs and of streams included, and
/// about memory, if something is brought that doubts it. None about a spec of another version.
///
/// # Errors
/// When the store cannot say what data a job reads.
pub async fn warnings(
    store: &Store,
    spec: &Value,
    memory: Option<&MemoryDoubts>,
) -> Result<Vec<String>, StoreError> {
    let Ok(spec) = serde_json::from_value::<JobSpec>(spec.clone()) else {
        return Ok(Vec::new());
    };
    let mut warnings: Vec<String> = spec.doubts().iter().map(ToString::to_string).collect();
    let Some(memory) = memory else { return Ok(warnings) };
    for (path, job) in spec.single_jobs() {
        let Some(data) = data(store, job).await? else { continue };
        if let Some(doubt) = kind(job).and_then(|kind| kind.memory_doubt(&data, memory)) {
            let doubt = if path.is_empty() { doubt } else { doubt.within(&path) };
            warnings.push(doubt.to_string());
        }
    }
    Ok(warnings)
}

/// The data that `job` reads; `None` when it is not known.
async fn data(store: &Store, job: &JobSpec) -> Result<Option<DataSpec>, StoreError> {
    let mut job = job.clone();
    let source = job.references().into_iter().find_map(|reference| match reference.to {
        Referred::Data(source) => Some(source.clone()),
        Referred::Checkpoint(_) | Referred::File(_) => None,
    });
    let digest = match source {
        Some(DataSource::Stream(spec)) => return Ok(Some(DataSpec::Simulation(*spec))),
        Some(DataSource::Digest(digest)) => digest,
        Some(DataSource::Job(_) | DataSource::Dataset(_)) | None => return Ok(None),
    };
    let job = store.job_by_digest(digest, &JobState::ALL).await?;
    let spec = job.and_then(|job| serde_json::from_value::<JobSpec>(job.spec).ok());
    Ok(spec.and_then(|spec| DataSpec::of(&spec)))
}
