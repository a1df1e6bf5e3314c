//! Evaluations: jobs that compare predictors, with their report.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::{Digest, JobKind, JobSpec};
use utoipa::ToSchema;

use crate::{Artifact, JobState, List, Listed, Report, Sort, TaskState};

/// A comparison of predictors. It has the id of its job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Evaluation {
    pub id: i64,
    pub run: i64,
    /// The name of its job. Note and tags are also those of the job.
    pub name: String,
    /// A note in Markdown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Its tags, sorted.
    #[serde(default)]
    pub tags: Vec<String>,
    pub digest: Digest,
    pub state: JobState,
    pub error: Option<String>,
    #[schema(value_type = JobSpec)]
    pub spec: Value,
    /// The report, when all cells are evaluated. Left out in a list of evaluations.
    pub report: Option<Report>,
    pub cells: Vec<CellTask>,
    /// The files of the evaluation: the table of each cell, the report, the table of all scenarios,
    /// and figures with their tables.
    pub artifacts: Vec<Artifact>,
    pub created_at: String,
}

/// The task of one cell. A cell is an excitation at one frequency, or all data if there is no
/// frequency grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CellTask {
    pub task: i64,
    #[schema(example = "multisine 0.15 Hz")]
    pub label: String,
    pub state: TaskState,
    /// Why the task or its last attempt failed.
    pub error: Option<String>,
}

impl Listed for Evaluation {
    const LIST: List = List {
        name: "evaluations",
        kinds: &[],
        only: Some(JobKind::Evaluate),
        states: &JobState::WORDS,
        sorts: &[Sort::Created, Sort::Finished, Sort::Name, Sort::Priority, Sort::Rmse],
    };
}

/// A page of evaluations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Evaluations {
    pub evaluations: Vec<Evaluation>,
    /// The `cursor` of the following page; `null` on the last one.
    pub next: Option<String>,
}
