//! Submissions and their outcome for the user. The crate `jobs` turns specs into jobs.

use spec::JobSpec;
use store::{Idempotency, JobId, Labels};
use wire::Job;

use crate::app::App;
use crate::error::ApiError;

pub use store::Reuse;

/// The outcome of a submission.
#[derive(Clone, Debug)]
pub struct Submitted {
    pub job: Job,
    /// Whether the job is new.
    pub created: bool,
}

impl App {
    /// Submits the spec in `text`: a job, or a pipeline with all its jobs, in one transaction.
    ///
    /// # Errors
    /// [`ApiError::Json`] or [`ApiError::Spec`] when it is refused. Nothing is queued then.
    pub async fn submit(
        &self,
        text: &[u8],
        reuse: Reuse,
        idempotency_key: Option<String>,
        labels: Labels,
    ) -> Result<Submitted, ApiError> {
        let limits = &self.limits;
        let submitted =
            jobs::submit(&self.store, limits, text, reuse, idempotency_key, labels).await?;
        self.submitted(submitted).await
    }

    /// Submits the spec of a failed or cancelled job again. Completed parts are not done again: the
    /// jobs of a pipeline, and the cells of an evaluation.
    ///
    /// # Errors
    /// [`ApiError::NotFailed`] for any other job. [`ApiError::Spec`] when something that the spec
    /// refers to is gone.
    pub async fn retry(&self, id: i64) -> Result<Submitted, ApiError> {
        let submitted = jobs::retry(&self.store, &self.limits, JobId(id)).await?;
        self.submitted(submitted).await
    }

    pub(super) async fn submit_spec(
        &self,
        spec: &JobSpec,
        reuse: Reuse,
        idempotency: Option<Idempotency>,
    ) -> Result<Submitted, ApiError> {
        let submitted =
            jobs::submit_spec(&self.store, &self.limits, spec, reuse, idempotency).await?;
        self.submitted(submitted).await
    }

    async fn submitted(&self, submitted: store::Submitted) -> Result<Submitted, ApiError> {
        Ok(Submitted { job: self.job(submitted.job.0).await?, created: !submitted.reused })
    }
}
