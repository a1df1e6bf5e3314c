//! Warnings about specs that were accepted.

use std::collections::{BTreeSet, HashMap};

use serde_json::Value;
use spec::{DataSource, DataSpec, Digest, Doubt, JobSpec, Referred};
use store::{Store, StoreError};

use crate::kind::{MemoryDoubts, kind};

/// Warnings about the values of stored specs, including those of a pipeline's jobs and of streams, and
/// about trainings that nothing validates. Also warnings about memory, if a function for it is passed
/// in. A spec of another version gets no
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
    let data = data_of(store, specs.iter().flatten()).await?;
    let warnings = |spec: &JobSpec| {
        let mut warnings: Vec<String> = spec.doubts().iter().map(ToString::to_string).collect();
        for (path, job) in spec.single_jobs() {
            let doubts = memory.and_then(|memory| memory_doubt(job, &data, memory)).into_iter();
            for doubt in doubts.chain(validation_doubt(job, &data)) {
                let doubt = if path.is_empty() { doubt } else { doubt.within(&path) };
                warnings.push(doubt.to_string());
            }
        }
        warnings
    };
    Ok(specs.iter().map(|spec| spec.as_ref().map(warnings).unwrap_or_default()).collect())
}

/// Why a job may not fit into memory, if its data is known.
fn memory_doubt(
    job: &JobSpec,
    data: &HashMap<Digest, DataSpec>,
    memory: &MemoryDoubts,
) -> Option<Doubt> {
    let data = match sources(job).into_iter().next()? {
        DataSource::Stream(spec) => DataSpec::Simulation(*spec),
        DataSource::Digest(digest) => data.get(&digest)?.clone(),
        DataSource::Job(_) | DataSource::Dataset(_) => return None,
    };
    kind(job)?.memory_doubt(&data, memory)
}

/// Why nothing validates a training, if the number of its trajectories is known. Otherwise its log says
/// it.
fn validation_doubt(job: &JobSpec, data: &HashMap<Digest, DataSpec>) -> Option<Doubt> {
    let JobSpec::Train(training) = job else { return None };
    let count = |source: &DataSource| data.get(&source.digest()?)?.trajectories();
    let counts: Vec<Option<u64>> = training.data.each().iter().map(count).collect();
    training.validation_doubt(&counts)
}

/// The stored data that jobs read, where it is known, by digest.
async fn data_of<'a>(
    store: &Store,
    specs: impl Iterator<Item = &'a JobSpec>,
) -> Result<HashMap<Digest, DataSpec>, StoreError> {
    let mut digests = BTreeSet::new();
    for spec in specs {
        for (_, job) in spec.single_jobs() {
            digests.extend(sources(job).iter().filter_map(DataSource::digest));
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
fn sources(job: &JobSpec) -> Vec<DataSource> {
    let mut job = job.clone();
    let sources = job.references().into_iter().filter_map(|reference| match reference.to {
        Referred::Data(source) => Some(source.clone()),
        Referred::Checkpoint(_) | Referred::File(_) => None,
    });
    sources.collect()
}
