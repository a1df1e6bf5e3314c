//! The kinds of things that a server has, each known by its id.

use clap::ValueEnum;

/// A kind of thing that the API and the page have an address for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Resource {
    /// A job that was submitted
    Job,
    /// Trajectories of many robots
    Dataset,
    /// The record of a training, an evaluation or a control job
    Run,
    /// Weights of a model
    Checkpoint,
    /// A comparison of predictors, by the id of its job
    Evaluation,
}

impl Resource {
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Job => "job",
            Self::Dataset => "dataset",
            Self::Run => "run",
            Self::Checkpoint => "checkpoint",
            Self::Evaluation => "evaluation",
        }
    }

    /// Its address in the API.
    pub fn api_path(self, id: i64) -> String {
        format!("/v1{}", self.page_path(id))
    }

    /// Its address on the page.
    pub fn page_path(self, id: i64) -> String {
        format!("/{}s/{id}", self.as_str())
    }
}
