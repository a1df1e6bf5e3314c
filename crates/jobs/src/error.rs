use spec::SpecError;
use store::{JobId, JobState, StoreError};
use thiserror::Error;

/// Why a submission was refused.
#[derive(Debug, Error)]
pub enum SubmissionError {
    /// The text is no JSON.
    #[error("the spec is not valid JSON: {0}")]
    Json(spec::JsonFault),
    /// The spec violates its rules, or refers to work that does not exist.
    #[error("{0}")]
    Spec(SpecError),
    /// A job that cannot be tried again.
    #[error("job {id} is {state}; only failed and cancelled jobs can be retried")]
    NotFailed {
        /// The job.
        id: JobId,
        /// Its state.
        state: JobState,
    },
    /// The store could not be read or written.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl SubmissionError {
    /// The same error, with the fields of a spec as seen from an enclosing spec.
    pub(crate) fn within(self, outer: &str) -> Self {
        match self {
            Self::Spec(error) => Self::Spec(error.within(outer)),
            other => other,
        }
    }
}

impl From<SpecError> for SubmissionError {
    fn from(error: SpecError) -> Self {
        Self::Spec(error)
    }
}
