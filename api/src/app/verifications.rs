//! Verifications: datasets that are made again and compared with the stored files.

use std::collections::BTreeMap;

use serde_json::Value;
use spec::{DataSource, Execution, JobKind, JobSpec, VerifySpec};
use store::{DatasetId, JobId, Labels, Reuse};
use wire::{DatasetState, Job, Verification, VerifiedShard};

use crate::app::App;
use crate::app::jobs::text;
use crate::error::ApiError;

/// The kind of its job.
const KIND: &str = JobKind::Verify.as_str();

/// Number of remarks that are shown. A dataset of another version has one remark per shard.
const REMARKS: u32 = 5;

/// The field of a [`VerifiedShard`] that says how its bytes compare.
const BYTES: &str = "bytes";

/// Its value, or the beginning of its value, if the bytes are the same.
const EQUAL: &str = "equal";

impl App {
    /// Queues a verification of this dataset, even if it was verified before.
    ///
    /// # Errors
    /// [`ApiError::DatasetIncomplete`] while shards are missing.
    pub(crate) async fn verify(&self, dataset: i64) -> Result<Job, ApiError> {
        let row = self.store.dataset(DatasetId(dataset)).await?;
        if row.state != DatasetState::Complete {
            let job = self.store.job(row.job).await?;
            return Err(ApiError::DatasetIncomplete {
                id: dataset,
                job: job.id.0,
                state: job.state,
            });
        }
        let data = DataSource::Dataset(dataset);
        let spec = JobSpec::Verify(VerifySpec { data, execution: Execution::default() });
        Ok(self.submit_spec(&spec, Reuse::Never, None, Labels::default()).await?.job)
    }

    /// The newest verification of a dataset.
    pub(crate) async fn verification(
        &self,
        dataset: i64,
    ) -> Result<Option<Verification>, ApiError> {
        let newest = self.store.newest_reader(DatasetId(dataset), KIND).await?;
        let Some(job) = newest else { return Ok(None) };
        let agreement = self.agreements(&[job.id.0]).await?.remove(&job.id.0).unwrap_or_default();
        Ok(Some(Verification {
            job: job.id.0,
            state: job.state,
            shards: agreement.shards,
            shards_verified: agreement.verified,
            shards_identical: agreement.identical,
            remarks: self.remarks(job.id).await?,
            error: job.error,
            finished_at: text(job.finished_at),
        }))
    }

    /// The results so far of the verifications among `jobs`, by job.
    pub(crate) async fn agreements(
        &self,
        jobs: &[i64],
    ) -> Result<BTreeMap<i64, Agreement>, ApiError> {
        let jobs: Vec<JobId> = jobs.iter().copied().map(JobId).collect();
        let mut agreements: BTreeMap<i64, Agreement> = BTreeMap::new();
        for tally in self.store.result_tallies(&jobs, BYTES).await? {
            let agreement = agreements.entry(tally.job.0).or_default();
            agreement.shards += tally.tasks;
            let Some(bytes) = tally.value else { continue };
            agreement.verified += tally.tasks;
            if bytes.starts_with(EQUAL) {
                agreement.identical += tally.tasks;
            }
        }
        Ok(agreements)
    }

    /// Remarks on shards whose bytes are not simply equal.
    async fn remarks(&self, job: JobId) -> Result<Vec<String>, ApiError> {
        let unlike = self.store.results_unlike(job, BYTES, EQUAL, REMARKS).await?;
        let remark = |(label, result): (String, Value)| {
            let VerifiedShard { bytes, values, .. } = serde_json::from_value(result).ok()?;
            let values = values.map(|values| format!(", values {values}"));
            Some(format!("{label}: bytes {bytes}{}", values.unwrap_or_default()))
        };
        Ok(unlike.into_iter().filter_map(remark).collect())
    }
}

/// How many shards of a dataset were compared, and with which result.
#[derive(Clone, Copy, Debug, Default)]
pub struct Agreement {
    pub shards: u64,
    /// Shards with the same values.
    pub verified: u64,
    /// Those of them with the same bytes.
    pub identical: u64,
}
