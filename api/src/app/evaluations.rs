//! Evaluations: jobs that compare predictors, with their report.

use serde::de::DeserializeOwned;
use spec::JobKind;
use store::{JobFilter, JobId, StoreError};
use wire::{CellTask, Evaluation, Evaluations};

use crate::app::{App, Paging};
use crate::error::ApiError;

/// The artifact that the last task of an evaluation or of a control job leaves.
const REPORT: &str = "report.json";

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

    /// The report that a job's last task left; `None` before its end, and of another version's
    /// report.
    pub async fn report<T: DeserializeOwned>(&self, job: i64) -> Result<Option<T>, ApiError> {
        let Some(run) = self.store.job(JobId(job)).await?.run else { return Ok(None) };
        let artifact = match self.store.artifact(run, REPORT).await {
            Ok(artifact) => artifact,
            Err(StoreError::NotFound { .. }) => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        let bytes = self.store.read_object(&artifact.object).await?;
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
