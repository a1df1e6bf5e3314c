//! Evaluations: jobs that compare predictors, with their report.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::{Digest, JobKind, JobSpec};
use utoipa::ToSchema;

use crate::{
    Artifact, Evaluations, Headline, JobState, List, ListCell, ListColumn, Listed, Report, Sort,
    Tabled, TaskState,
};

/// A comparison of predictors. It has the id of its job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Evaluation {
    /// The id of its job.
    pub id: i64,
    /// The run that has its files.
    pub run: i64,
    /// The name of its job. Note and tags are also those of the job.
    pub name: String,
    /// A note in Markdown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Its tags, sorted.
    #[serde(default)]
    pub tags: Vec<String>,
    /// The digest of its spec.
    pub digest: Digest,
    /// The state of its job.
    pub state: JobState,
    /// Why the job failed or was cancelled.
    pub error: Option<String>,
    /// The mean errors of the best predictors, when all cells are evaluated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub headline: Option<Headline>,
    /// The names of the data that its job reads, separated by commas. Robots that are simulated
    /// as they are needed are called `stream`. Missing without data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data: Option<String>,
    /// The spec of its job.
    #[schema(value_type = JobSpec)]
    pub spec: Value,
    /// The report, when all cells are evaluated. Left out in a list of evaluations.
    pub report: Option<Report>,
    /// The cells, in the order of the evaluation.
    pub cells: Vec<CellTask>,
    /// The files of the evaluation: the table of each cell, the report, the table of all scenarios,
    /// and figures with their tables.
    pub artifacts: Vec<Artifact>,
    /// When it was submitted.
    pub created_at: String,
}

/// The task of one cell. A cell is an excitation at one frequency, or all data if there is no
/// frequency grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CellTask {
    /// The id of the task.
    pub task: i64,
    /// The excitation and its frequency.
    #[schema(example = "multisine 0.15 Hz")]
    pub label: String,
    /// The state of the task.
    pub state: TaskState,
    /// Why the task or its last attempt failed.
    pub error: Option<String>,
}

impl Tabled for Evaluation {
    const COLUMNS: &'static [ListColumn<Self>] = &[
        ListColumn::words("state", |evaluation| ListCell::state(evaluation.state)),
        ListColumn::number("cells", |evaluation| {
            let is_done = |cell: &&CellTask| cell.state == TaskState::Succeeded;
            let done = evaluation.cells.iter().filter(is_done).count();
            ListCell::part(done as u64, evaluation.cells.len() as u64)
        }),
        ListColumn::words("mean RMSE", |evaluation| {
            ListCell::some(evaluation.headline.clone(), ListCell::Headline)
        }),
        ListColumn::words("data", |evaluation| {
            ListCell::some(evaluation.data.clone(), ListCell::Text)
        }),
        ListColumn::number("run", |evaluation| ListCell::text(evaluation.run)),
        ListColumn::number("created", |evaluation| ListCell::moment(&evaluation.created_at)),
    ];
}

impl Listed for Evaluation {
    const LIST: List = List {
        name: "evaluations",
        empty: "An evaluation compares checkpoints and baselines on the same scenarios.",
        kinds: &[],
        only: Some(JobKind::Evaluate),
        states: &JobState::WORDS,
        sorts: &[Sort::Created, Sort::Finished, Sort::Name, Sort::Priority, Sort::Rmse],
        has_labels: true,
        has_columns: false,
    };

    type Page = Evaluations;

    fn id(&self) -> i64 {
        self.id
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn tags(&self) -> Vec<&str> {
        self.tags.iter().map(String::as_str).collect()
    }
}
