//! Submissions and their outcome for the user. The crate `jobs` turns specs into jobs.

use axum::body::Bytes;
use jobs::SentSpec;
use spec::JobSpec;
use store::{Idempotency, JobId, Labels};
use wire::Job;

use crate::app::App;
use crate::error::ApiError;
use crate::limits::BODY_BYTES;

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
    pub(crate) async fn submit(
        &self,
        text: Bytes,
        reuse: Reuse,
        idempotency_key: Option<String>,
        labels: Labels,
    ) -> Result<Submitted, ApiError> {
        let idempotency = idempotency_key.map(|key| jobs::idempotency(&text, reuse, key));
        if let Some(earlier) = jobs::repeated(&self.store, idempotency.as_ref()).await? {
            return self.submitted(earlier).await;
        }
        let sent = self.sent(text).await?;
        let spec = self.checks.run(sent.bytes, move || Ok(sent.parse()?)).await?;
        self.submit_spec(&spec, reuse, idempotency, labels).await
    }

    /// A spec as it was sent, with the robots of this server that it names.
    ///
    /// # Errors
    /// [`ApiError::Json`] when it is no JSON. [`ApiError::Spec`] when there is no such robot.
    pub(super) async fn sent(&self, text: Bytes) -> Result<SentSpec, ApiError> {
        let sent = self.checks.run(text.len(), move || Ok(SentSpec::read(&text)?)).await?;
        Ok(sent.with_robots(&self.store).await?)
    }

    /// Submits the spec of a failed or cancelled job again. Completed parts are not done again: the
    /// jobs of a pipeline, and the cells of an evaluation.
    ///
    /// # Errors
    /// [`ApiError::NotFailed`] for any other job. [`ApiError::Spec`] when something that the spec
    /// refers to is gone.
    pub(crate) async fn retry(&self, id: i64) -> Result<Submitted, ApiError> {
        let retried = jobs::retried(&self.store, JobId(id)).await?;
        let labels = retried.labels.clone();
        // The size of a stored spec is only known when it is written.
        let spec = self.checks.run(BODY_BYTES, move || Ok(retried.read()?)).await?;
        self.submit_spec(&spec, Reuse::SameDigest, None, labels).await
    }

    pub(super) async fn submit_spec(
        &self,
        spec: &JobSpec,
        reuse: Reuse,
        idempotency: Option<Idempotency>,
        labels: Labels,
    ) -> Result<Submitted, ApiError> {
        let limits = &self.limits;
        let submitted = jobs::submit(&self.store, limits, spec, reuse, idempotency, labels).await?;
        self.submitted(submitted).await
    }

    async fn submitted(&self, submitted: store::Submitted) -> Result<Submitted, ApiError> {
        Ok(Submitted { job: self.job(submitted.job.0).await?, created: !submitted.reused })
    }
}
