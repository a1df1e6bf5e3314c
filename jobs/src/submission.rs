//! Submissions: turns a spec as sent into jobs in the store.

use serde::de::IgnoredAny;
use serde_json::json;
use spec::{Digest, JobSpec, SpecError};
use store::{Idempotency, JobId, JobState, Labels, Reuse, Store, Submission, Submitted, Timestamp};

use crate::SubmissionError;
use crate::execution;
use crate::kind::{Limits, kind};
use crate::pipeline::plan_pipeline;
use crate::plan::plan;
use crate::references::References;

/// Submits the spec in `text`: a job, or a pipeline with all its jobs, in one transaction.
///
/// # Errors
/// [`SubmissionError::Json`] or [`SubmissionError::Spec`] when it is refused. Nothing is queued
/// then.
pub async fn submit(
    store: &Store,
    limits: &Limits,
    text: &[u8],
    reuse: Reuse,
    idempotency_key: Option<String>,
    labels: Labels,
) -> Result<Submitted, SubmissionError> {
    let idempotency = idempotency_key.map(|key| Idempotency {
        key,
        request: Digest::of_json(&json!([Digest::of(text), reuse == Reuse::Never])),
    });
    if let Some(submitted) = repeated(store, idempotency.as_ref()).await? {
        return Ok(submitted);
    }
    spec::read_json::<IgnoredAny>(text).map_err(SubmissionError::Json)?;
    let spec = spec::parse(text)?;
    submit_new(store, limits, &spec, reuse, idempotency, labels).await
}

/// Submits the spec of a failed or cancelled job again. Parts that succeeded are not done again:
/// the jobs of a pipeline, and the tasks of kinds that take over tasks. The new job has the labels
/// of the old one.
///
/// # Errors
/// [`SubmissionError::NotFailed`] for any other job. [`SubmissionError::Spec`] when the spec refers
/// to something that is gone.
pub async fn retry(
    store: &Store,
    limits: &Limits,
    id: JobId,
) -> Result<Submitted, SubmissionError> {
    let job = store.job(id).await?;
    if !matches!(job.state, JobState::Failed | JobState::Cancelled) {
        return Err(SubmissionError::NotFailed { id, state: job.state });
    }
    let mut spec = spec::parse(job.spec.to_string().as_bytes())?;
    if let JobSpec::Pipeline(pipeline) = &mut spec {
        pipeline.name_siblings();
    }
    let labels =
        Labels { name: job.given_name, note: job.note, tags: job.tags.into_iter().collect() };
    submit_new(store, limits, &spec, Reuse::SameDigest, None, labels).await
}

/// Like [`submit`], for a spec that [`spec::parse`] has read.
///
/// # Errors
/// When it is refused. Nothing is queued then.
pub async fn submit_spec(
    store: &Store,
    limits: &Limits,
    spec: &JobSpec,
    reuse: Reuse,
    idempotency: Option<Idempotency>,
) -> Result<Submitted, SubmissionError> {
    match repeated(store, idempotency.as_ref()).await? {
        Some(submitted) => Ok(submitted),
        None => submit_new(store, limits, spec, reuse, idempotency, Labels::default()).await,
    }
}

/// The outcome of an earlier submission of the same request. It is looked up before the request is
/// checked, because limits and the things that a spec refers to may have changed.
async fn repeated(
    store: &Store,
    idempotency: Option<&Idempotency>,
) -> Result<Option<Submitted>, SubmissionError> {
    match idempotency {
        Some(asked) => Ok(store.repeated(asked).await?),
        None => Ok(None),
    }
}

async fn submit_new(
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

fn check_limits(spec: &JobSpec, limits: &Limits, now: Timestamp) -> Result<(), SpecError> {
    let mut violations = Vec::new();
    for (path, spec) in spec.single_jobs() {
        let of_kind = kind(spec).map_or(Ok(()), |kind| kind.check_limits(limits));
        let of_execution = execution::check(spec, limits, now);
        for error in [of_kind, of_execution].into_iter().filter_map(Result::err) {
            let error = if path.is_empty() { error } else { error.within(&path) };
            violations.extend(error.violations);
        }
    }
    if violations.is_empty() { Ok(()) } else { Err(SpecError { violations }) }
}
