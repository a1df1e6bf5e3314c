use store::{Retry, StoreError};
use thiserror::Error;

/// Why a worker cannot go on at all.
#[derive(Debug, Error)]
pub enum WorkerError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("start {threads} threads: {source}")]
    Threads {
        threads: usize,
        #[source]
        source: rayon::ThreadPoolBuildError,
    },
}

/// Why an attempt at a task did not end well.
#[derive(Debug, Error)]
pub(crate) enum TaskError {
    #[error("stopped on request")]
    Stopped,
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Dynamics(#[from] dynamics::DynamicsError),
    #[error(transparent)]
    Model(#[from] models::ModelError),
    #[error(transparent)]
    Evaluation(#[from] evaluation::EvaluationError),
    #[error("draw a figure: {0}")]
    Figure(#[from] figures::FigureError),
    #[error("arrange columns: {0}")]
    Columns(#[from] arrow::error::ArrowError),
    #[error("the stored spec cannot be read: {0}")]
    Spec(#[from] serde_json::Error),
    #[error("{what} {name} does not exist any more")]
    Missing { what: &'static str, name: String },
    #[error("{0}")]
    Panicked(String),
}

impl TaskError {
    /// Whether another attempt could end otherwise: what depends on disk and database alone may.
    pub fn retry(&self) -> Retry {
        match self {
            Self::Store(_) | Self::Stopped => Retry::Allowed,
            Self::Dynamics(_)
            | Self::Model(_)
            | Self::Evaluation(_)
            | Self::Figure(_)
            | Self::Columns(_)
            | Self::Spec(_)
            | Self::Missing { .. }
            | Self::Panicked(_) => Retry::Never,
        }
    }
}
