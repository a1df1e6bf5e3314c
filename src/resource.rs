//! The kinds of things that a server has. Each thing is known by its id.

use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use clap::ValueEnum;

/// A kind of thing with an address in the API and on the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Resource {
    /// A job that was submitted
    #[value(alias = "jobs")]
    Job,
    /// Trajectories of many robots
    #[value(alias = "datasets")]
    Dataset,
    /// The record of a training, an evaluation or a control job
    #[value(alias = "runs")]
    Run,
    /// The weights of a model
    #[value(alias = "checkpoints")]
    Checkpoint,
    /// A comparison of predictors, by the id of its job
    #[value(alias = "evaluations")]
    Evaluation,
}

/// A kind of thing that can be deleted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Deletable {
    /// A job with its logs and all its results; a pipeline with the jobs that were made for it
    #[value(alias = "jobs")]
    Job,
    /// The record of a training, an evaluation or a control job, with its checkpoints
    #[value(alias = "runs")]
    Run,
    /// Trajectories of many robots
    #[value(alias = "datasets")]
    Dataset,
    /// The weights of a model
    #[value(alias = "checkpoints")]
    Checkpoint,
}

impl Deletable {
    /// Its address in the API.
    pub fn api_path(self, id: impl Display) -> String {
        let resource = match self {
            Self::Job => Resource::Job,
            Self::Run => Resource::Run,
            Self::Dataset => Resource::Dataset,
            Self::Checkpoint => Resource::Checkpoint,
        };
        resource.api_path(id)
    }
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
    pub fn api_path(self, id: impl Display) -> String {
        format!("/v1{}", self.page_path(id))
    }

    /// Its address on the page.
    pub fn page_path(self, id: impl Display) -> String {
        format!("/{}s/{id}", self.as_str())
    }
}

/// The id of a thing, or the alias of a checkpoint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reference(String);

impl FromStr for Reference {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.parse::<i64>().is_ok() || api::is_alias(text) {
            return Ok(Self(text.to_owned()));
        }
        Err("an id, or the alias of a checkpoint, which begins with a letter".to_owned())
    }
}

impl Display for Reference {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reference_is_an_id_or_an_alias() {
        for text in ["7", "champion", "v1.2_b"] {
            assert_eq!(text.parse::<Reference>().unwrap().to_string(), text);
        }
        for text in ["", "7b", "a/b", "a?b", "../jobs/3"] {
            assert!(text.parse::<Reference>().is_err(), "{text}");
        }
    }
}
