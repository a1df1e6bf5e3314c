//! Verifications: datasets made again and compared with what is stored.

use serde::Deserialize;
use spec::{DataSource, Execution, JobKind, JobSpec, VerifySpec};
use store::{DatasetId, JobId, Reuse};
use wire::{DatasetState, Job, TaskState, Verification, VerifiedShard};

use crate::app::App;
use crate::app::jobs::text;
use crate::error::ApiError;

/// The name of its job.
const KIND: &str = JobKind::Verify.as_str();

/// Remarks shown of a verification; a dataset of another version has one per shard.
const REMARKS: usize = 5;

impl App {
    /// Queues a verification of this very dataset, whatever was verified before.
    ///
    /// # Errors
    /// [`ApiError::DatasetIncomplete`] while shards are missing.
    pub async fn verify(&self, dataset: i64) -> Result<Job, ApiError> {
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
        Ok(self.submit_spec(&spec, Reuse::Never, None).await?.job)
    }

    /// The newest verification of a dataset.
    pub async fn verification(&self, dataset: i64) -> Result<Option<Verification>, ApiError> {
        match self.store.newest_reader(DatasetId(dataset), KIND).await? {
            Some(job) => Ok(Some(self.outcome(job).await?)),
            None => Ok(None),
        }
    }

    /// What the verification that `job` is has found so far.
    pub async fn verification_by(&self, job: i64) -> Result<Verification, ApiError> {
        let job = self.store.job(JobId(job)).await?;
        self.outcome(job).await
    }

    async fn outcome(&self, job: store::Job) -> Result<Verification, ApiError> {
        let tasks = self.store.tasks(job.id).await?;
        let verified = tasks.iter().filter(|task| task.state == TaskState::Succeeded);
        let mut verification = Verification {
            job: job.id.0,
            state: job.state,
            shards: tasks.len() as u64,
            shards_verified: 0,
            shards_identical: 0,
            remarks: Vec::new(),
            error: job.error,
            finished_at: text(job.finished_at),
        };
        for task in verified {
            let result = task.result.as_ref();
            let Some(VerifiedShard { bytes, values, .. }) =
                result.and_then(|result| VerifiedShard::deserialize(result).ok())
            else {
                continue;
            };
            verification.shards_verified += 1;
            if bytes.starts_with("equal") {
                verification.shards_identical += 1;
            }
            if bytes != "equal" && verification.remarks.len() < REMARKS {
                let values = values.map(|values| format!(", values {values}"));
                let remark = format!("{}: bytes {bytes}{}", task.label, values.unwrap_or_default());
                verification.remarks.push(remark);
            }
        }
        Ok(verification)
    }
}
