//! Verifications: one task per shard, which makes the shard again and compares it with the stored
//! one.
//!
//! A shard is made again as digests alone, which are compared with those of the stored files and
//! with the recorded ones. Only if they differ is anything decoded, to name the first trajectory,
//! column and step. Files of another version may differ in bytes, but not in values.

mod difference;
mod place;
mod shard;

use jobs::VerifyTask;
use spec::{DataSource, DataSpec, ImportSpec, JobSpec, VerifySpec};
use store::{Dataset, DatasetId, ObjectWriter, ShardContents};
use wire::VerifiedShard;

use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::import;
use crate::kinds::KindModule;
use crate::simulate::{SimulatedShard, VERSION};

pub(crate) use place::FileLocation;
pub(crate) use shard::{Agreement, verify};

pub(crate) const MODULE: KindModule = KindModule { run, computes_models: false };

/// Verifies the shard of a task.
fn run(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: VerifySpec = attempt.spec()?;
    let task: VerifyTask = attempt.payload()?;
    let dataset = dataset(attempt, &spec, task.dataset)?;
    let ordinal = task.shard;
    let missing = || TaskError::Missing { what: "shard", name: ordinal.to_string() };
    let shards = attempt.wait(attempt.store.shards(dataset.id))?;
    let shard = shards.iter().find(|shard| shard.ordinal == ordinal).ok_or_else(missing)?;
    let job: JobSpec = serde_json::from_value(dataset.spec.clone())?;
    let (bytes, values) = match DataSpec::of(&job) {
        Some(DataSpec::Simulation(spec)) => {
            let simulated = SimulatedShard::new(&spec, dataset.digest, ordinal);
            let place = FileLocation::Store(&attempt.store);
            let progress = |done: u64| attempt.show(done);
            verify(&simulated, &shard.contents, place, &progress)?.words()
        }
        Some(DataSpec::Import(spec)) => verify_import(attempt, &spec, &shard.contents)?,
        None => return Err(missing()),
    };
    tracing::info!(dataset = %dataset.id, shard = ordinal, bytes, values, "compared");
    attempt.complete(&VerifiedShard { shard: ordinal, dataset: dataset.id.0, bytes, values })
}

/// The dataset that the task names, or the newest with the digest.
fn dataset(attempt: &Attempt, spec: &VerifySpec, id: Option<i64>) -> Result<Dataset, TaskError> {
    let missing = |name: String| TaskError::Missing { what: "dataset", name };
    if let Some(id) = id {
        return Ok(attempt.wait(attempt.store.dataset(DatasetId(id)))?);
    }
    // Submission replaced every other form of reference by a digest.
    let DataSource::Digest(digest) = &spec.data else {
        return Err(missing(format!("{:?}", spec.data)));
    };
    let found = attempt.wait(attempt.store.dataset_by_digest(*digest))?;
    found.ok_or_else(|| missing(digest.to_string()))
}

/// Converts the uploads again. Without all of them, only the recorded digests are compared.
fn verify_import(
    attempt: &Attempt,
    spec: &ImportSpec,
    recorded: &ShardContents,
) -> Result<Words, TaskError> {
    let place = FileLocation::Store(&attempt.store);
    for (_, recorded) in recorded.files() {
        attempt.check_stop()?;
        let stored = shard::measure(place, recorded)?;
        if stored.sha256 != recorded.sha256 {
            return Err(TaskError::Differs(format!(
                "{} has SHA-256 {}, not {} as recorded",
                recorded.path, stored.sha256, recorded.sha256
            )));
        }
    }
    let mut uploads = Vec::new();
    for (name, file) in spec.sources() {
        let Some(upload) = attempt.wait(attempt.store.upload(file))? else {
            let bytes = "equal to what was recorded; not converted again, as an upload is gone";
            return Ok((bytes.to_owned(), None));
        };
        uploads.push(Ok((name, upload)));
    }
    let rows = import::decode(attempt, uploads.into_iter(), spec);
    let [trajectories, table] =
        recorded.files().map(|(_, file)| ObjectWriter::digest_only(&file.path));
    let made = import::convert(rows, spec, trajectories, table, &|done| attempt.show(done))?.shard;
    for (content, recorded) in recorded.files() {
        let made = made.file(content);
        if recorded.sha256 != made.sha256 {
            return Err(TaskError::Differs(format!(
                "{} has SHA-256 {}, but {} when it is converted again by version {VERSION}",
                recorded.path, recorded.sha256, made.sha256
            )));
        }
    }
    Ok(Agreement::Bytes.words())
}

/// How the bytes agree and, where they differ, how the values do, in words.
type Words = (String, Option<String>);

impl Agreement {
    fn words(&self) -> Words {
        match self {
            Self::Bytes => ("equal".to_owned(), None),
            Self::Values { version, tolerance } => (
                format!("differ, written by version {version}"),
                Some(format!("equal within {tolerance}")),
            ),
        }
    }
}
