//! The service in MLflow's terms: experiments, torqued's own runs, and the runs that clients log
//! beside them.

mod artifacts;
mod experiments;
mod own_labels;
mod own_runs;
mod runs;
mod search;

use std::fmt;

use store::{ExperimentId, RunId};

use crate::mlflow::{ErrorCode, MlflowError};

pub use artifacts::{ArtifactPlace, artifact_name};
pub use experiments::ExperimentSearch;
pub use own_runs::params as spec_fields;
pub use search::RunSearch;

/// A run as clients name it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RunName {
    /// One of torqued's own runs: `torqued-17`.
    Own(RunId),
    /// A run that a client logs.
    Tracked(String),
}

const OWN: &str = "torqued-";

impl RunName {
    pub fn parse(text: &str) -> Self {
        let number = text.strip_prefix(OWN).and_then(|number| number.parse().ok());
        number.map_or_else(|| Self::Tracked(text.to_owned()), |id| Self::Own(RunId(id)))
    }

    /// The name, if clients may write to the run.
    pub fn writable(&self) -> Result<&str, MlflowError> {
        match self {
            Self::Tracked(identifier) => Ok(identifier),
            Self::Own(_) => {
                let message = format!(
                    "run {self} is torqued's own and takes no metrics, params, files or deletions here, only labels; create a run to log to"
                );
                Err(MlflowError::refused(ErrorCode::PermissionDenied, message))
            }
        }
    }
}

impl fmt::Display for RunName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Own(id) => write!(f, "{OWN}{id}"),
            Self::Tracked(identifier) => f.write_str(identifier),
        }
    }
}

/// Reads an id, which clients send as text.
pub fn experiment_id(text: &str) -> Result<ExperimentId, MlflowError> {
    let id = text.parse().map(ExperimentId);
    id.map_err(|_| MlflowError::not_found(format!("there is no experiment {text:?}")))
}

/// The location of an experiment's files for clients. A run's name is appended for its files.
fn artifact_location(experiment: ExperimentId) -> String {
    format!("mlflow-artifacts:/{experiment}")
}

fn artifact_uri(experiment: ExperimentId, run: &RunName) -> String {
    format!("mlflow-artifacts:/{experiment}/{run}/artifacts")
}

/// The items of a page, and the token of the next one: the number of items before it.
fn page<T>(items: Vec<T>, skipped: usize, limit: u32) -> (Vec<T>, Option<String>) {
    let end = skipped.saturating_add(usize::try_from(limit).unwrap_or(usize::MAX));
    let next = (end < items.len()).then(|| end.to_string());
    let shown = items.into_iter().skip(skipped).take(end - skipped).collect();
    (shown, next)
}
