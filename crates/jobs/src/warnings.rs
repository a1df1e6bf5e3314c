//! Warnings about specs that were accepted.

use std::collections::{BTreeSet, HashMap};

use serde_json::Value;
use spec::{DataSource, DataSpec, Digest, JobSpec, Referred};
use store::{Store, StoreError};

use crate::kind::{MemoryDoubts, kind};

/// Warnings about the values of stored specs, including those of a pipeline's jobs and of streams.
/// Also warnings about memory, if a function for it is passed in. A spec of another version gets no
/// warnings. The store is asked once for all specs.
///
/// # Errors
/// When the store cannot look up the data that the jobs read.
pub async fn warnings(
    store: &Store,
    specs: &[&Value],
    memory: Option<&MemoryDoubts>,
) -> Result<Vec<Vec<String>>, StoreError> {
    let specs: Vec<Option<JobSpec>> =
        specs.iter().map(|spec| serde_json::from_value((*spec).clone()).ok()).collect();
    let data = match memory {
        Some(_) => data_of(store, specs.iter().flatten()).await?,
        None => HashMap::new(),
    };
    let warnings = |spec: &JobSpec| {
        let mut warnings: Vec<String> = spec.doubts().iter().map(ToString::to_string).collect();
        let Some(memory) = memory else { return warnings };
        for (path, job) in spec.single_jobs() {
            let data = match source(job) {
                Some(DataSource::Stream(spec)) => Some(DataSpec::Simulation(*spec)),
                Some(DataSource::Digest(digest)) => data.get(&digest).cloned(),
                Some(DataSource::Job(_) | DataSource::Dataset(_)) | None => None,
            };
            let Some(data) = data else { continue };
            if let Some(doubt) = kind(job).and_then(|kind| kind.memory_doubt(&data, memory)) {
                let doubt = if path.is_empty() { doubt } else { doubt.within(&path) };
                warnings.push(doubt.to_string());
            }
        }
        warnings
    };
    Ok(specs.iter().map(|spec| spec.as_ref().map(warnings).unwrap_or_default()).collect())
}

/// The stored data that jobs read, where it is known, by digest.
async fn data_of<'a>(
    store: &Store,
    specs: impl Iterator<Item = &'a JobSpec>,
) -> Result<HashMap<Digest, DataSpec>, StoreError> {
    let mut digests = BTreeSet::new();
    for spec in specs {
        for (_, job) in spec.single_jobs() {
            if let Some(DataSource::Digest(digest)) = source(job) {
                digests.insert(digest);
            }
        }
    }
    if digests.is_empty() {
        return Ok(HashMap::new());
    }
    let digests: Vec<Digest> = digests.into_iter().collect();
    let known = |(digest, spec): (Digest, Value)| {
        let spec: JobSpec = serde_json::from_value(spec).ok()?;
        Some((digest, DataSpec::of(&spec)?))
    };
    Ok(store.newest_specs(&digests).await?.into_iter().filter_map(known).collect())
}

/// The trajectories that `job` reads.
fn source(job: &JobSpec) -> Option<DataSource> {
    let mut job = job.clone();
    job.references().into_iter().find_map(|reference| match reference.to {
        Referred::Data(source) => Some(source.clone()),
        Referred::Checkpoint(_) | Referred::File(_) => None,
    })
}
