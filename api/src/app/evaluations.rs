//! Evaluations: jobs that compare predictors, with their report.

use serde::Serialize;
use serde_json::Value;
use spec::{Digest, EvaluateSpec, JobKind};
use store::{JobFilter, JobId, JobState, StoreError, TaskState};
use utoipa::ToSchema;

use crate::app::runs::Artifact;
use crate::app::{App, Paging, Report};
use crate::error::ApiError;

/// The artifact that an evaluation's last task leaves.
const REPORT: &str = "report.json";

/// A comparison of predictors; its id is that of its job.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Evaluation {
    pub id: i64,
    pub run: i64,
    pub name: String,
    pub digest: Digest,
    #[schema(value_type = String, example = "succeeded")]
    pub state: JobState,
    pub error: Option<String>,
    #[schema(value_type = EvaluateSpec)]
    pub spec: Value,
    /// Written when all cells are there; in a list of evaluations, left out.
    #[schema(value_type = Option<Report>)]
    pub report: Option<Value>,
    pub cells: Vec<CellTask>,
    /// The table of each cell; the report, the table of all scenarios, and figures with their tables.
    pub artifacts: Vec<Artifact>,
    pub created_at: String,
}

/// How far one excitation at one frequency is.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct CellTask {
    pub task: i64,
    #[schema(example = "multisine 0.15 Hz")]
    pub label: String,
    #[schema(value_type = String, example = "succeeded")]
    pub state: TaskState,
    /// Why it failed, or its last attempt did.
    pub error: Option<String>,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Evaluations {
    pub evaluations: Vec<Evaluation>,
    /// The `before` of the following page.
    pub next: Option<i64>,
}

impl App {
    pub async fn evaluation(&self, id: i64) -> Result<Evaluation, ApiError> {
        let job = self.store.job(JobId(id)).await?;
        let mut evaluation = self.complete_evaluation(job).await?;
        evaluation.report = self.report(id).await?;
        Ok(evaluation)
    }

    pub async fn evaluations(&self, paging: Paging) -> Result<Evaluations, ApiError> {
        let filter = JobFilter { kind: Some(JobKind::Evaluate.as_str()), ..JobFilter::default() };
        let rows = self.store.jobs(filter, paging.into()).await?;
        let next = paging.next(rows.len(), rows.last().map(|row| row.id.0));
        let mut evaluations = Vec::with_capacity(rows.len());
        for row in rows {
            evaluations.push(self.complete_evaluation(row).await?);
        }
        Ok(Evaluations { evaluations, next })
    }

    /// The report of an evaluation as it was written, if it was.
    pub async fn report(&self, evaluation: i64) -> Result<Option<Value>, ApiError> {
        let Some(run) = self.store.job(JobId(evaluation)).await?.run else { return Ok(None) };
        let artifact = match self.store.artifact(run, REPORT).await {
            Ok(artifact) => artifact,
            Err(StoreError::NotFound { .. }) => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        let bytes = self.store.read_object(&artifact.object).await?;
        // Its bytes are those that were published, so this only fails for another version's report.
        Ok(serde_json::from_slice(&bytes).ok())
    }

    async fn complete_evaluation(&self, job: store::Job) -> Result<Evaluation, ApiError> {
        let Some(run) = job.run.filter(|_| job.kind == JobKind::Evaluate.as_str()) else {
            return Err(ApiError::not_found("evaluation", job.id));
        };
        let tasks = self.store.tasks(job.id).await?;
        let cells = tasks.into_iter().filter(|task| task.stage == 0).map(|task| CellTask {
            task: task.id.0,
            label: task.label,
            state: task.state,
            error: task.error,
        });
        Ok(Evaluation {
            cells: cells.collect(),
            artifacts: self.artifacts(run).await?,
            id: job.id.0,
            run: run.0,
            name: job.name,
            digest: job.digest,
            state: job.state,
            error: job.error,
            spec: job.spec,
            report: None,
            created_at: job.created_at.to_string(),
        })
    }
}

impl Evaluation {
    /// The report as the page reads it; `None` when it is missing or of another version.
    pub fn read_report(&self) -> Option<Report> {
        self.report.clone().and_then(|report| serde_json::from_value(report).ok())
    }
}
