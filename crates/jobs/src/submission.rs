//! Submissions: turns a spec as sent into jobs in the store.

use serde_json::{Value, json};
use spec::{Digest, JobSpec, SpecError};
use store::{Idempotency, JobId, JobState, Labels, Reuse, Store, Submission, Submitted, Timestamp};

use crate::SubmissionError;
use crate::execution;
use crate::kind::{Limits, kind};
use crate::pipeline::plan_pipeline;
use crate::plan::plan;
use crate::references::References;

/// The key with a digest of the request. A repeated request has the same digest.
pub fn idempotency(text: &[u8], reuse: Reuse, key: String) -> Idempotency {
    let request = Digest::of_json(&json!([Digest::of(text), reuse == Reuse::Never]));
    Idempotency { key, request }
}

/// A job that can be tried again: its spec as it is stored, and its labels.
pub struct Retried {
    spec: Value,
    /// The labels that its next attempt gets as well.
    pub labels: Labels,
}

/// Finds the failed or cancelled job with this id.
///
/// # Errors
/// [`SubmissionError::NotFailed`] for any other job.
pub async fn retried(store: &Store, id: JobId) -> Result<Retried, SubmissionError> {
    let job = store.job(id).await?;
    if !matches!(job.state, JobState::Failed | JobState::Cancelled) {
        return Err(SubmissionError::NotFailed { id, state: job.state });
    }
    let labels =
        Labels { name: job.given_name, note: job.note, tags: job.tags.into_iter().collect() };
    Ok(Retried { spec: job.spec, labels })
}

impl Retried {
    /// The spec to submit again, like [`SentSpec::parse`](crate::SentSpec::parse). Parts that succeeded are not done again: the jobs
    /// of a pipeline, and the tasks of kinds that take over tasks.
    ///
    /// # Errors
    /// [`SubmissionError::Spec`] when this version refuses it.
    pub fn read(self) -> Result<JobSpec, SubmissionError> {
        let mut spec = spec::parse_json(self.spec)?;
        if let JobSpec::Pipeline(pipeline) = &mut spec {
            pipeline.name_siblings();
        }
        Ok(spec)
    }
}

/// Submits a spec that was read: a job, or a pipeline with all its jobs, in one transaction. Ask
/// [`repeated`] before it reads the spec of a request with a key.
///
/// # Errors
/// [`SubmissionError::Spec`] when it exceeds a limit, or refers to something that is gone. Nothing
/// is queued then.
pub async fn submit(
    store: &Store,
    limits: &Limits,
    spec: &JobSpec,
    reuse: Reuse,
    idempotency: Option<Idempotency>,
    labels: Labels,
) -> Result<Submitted, SubmissionError> {
    check_limits(spec, limits, store.now().await?)?;
    let references = References::new(store);
    let (jobs, pipeline) = match spec {
        JobSpec::Pipeline(pipeline) => {
            let (jobs, pipeline) = plan_pipeline(references, pipeline, limits).await?;
            (jobs, Some(pipeline))
        }
        single => (vec![plan(None, &references.resolve(single).await?, limits)?], None),
    };
    Ok(store.submit(Submission { jobs, pipeline, reuse, idempotency, labels }).await?)
}

/// The outcome of an earlier submission of the same request. It is looked up before the request is
/// checked, because limits and the things that a spec refers to may have changed.
///
/// # Errors
/// When another request had the same key.
pub async fn repeated(
    store: &Store,
    idempotency: Option<&Idempotency>,
) -> Result<Option<Submitted>, SubmissionError> {
    match idempotency {
        Some(asked) => Ok(store.repeated(asked).await?),
        None => Ok(None),
    }
}

fn check_limits(spec: &JobSpec, limits: &Limits, now: Timestamp) -> Result<(), SpecError> {
    let mut found = SpecError::default();
    for (path, spec) in spec.single_jobs() {
        let of_kind = kind(spec).map_or(Ok(()), |kind| kind.check_limits(limits));
        let of_execution = execution::check(spec, limits, now);
        for error in [of_kind, of_execution].into_iter().filter_map(Result::err) {
            let error = if path.is_empty() { error } else { error.within(&path) };
            found.append(error);
        }
    }
    found.into_result()
}
