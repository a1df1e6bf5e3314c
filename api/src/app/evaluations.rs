//! Evaluations: jobs that compare predictors, with their report.

use std::collections::{BTreeMap, HashMap};

use serde::de::DeserializeOwned;
use spec::JobKind;
use store::{Artifact, JobId, Listed, RunId};
use wire::{CellTask, Evaluation, Evaluations};

use crate::app::App;
use crate::app::listing::ListRequest;
use crate::error::ApiError;

/// The artifact of the last task of an evaluation or a control job.
const REPORT: &str = "report.json";

impl App {
    pub async fn evaluation(&self, id: i64) -> Result<Evaluation, ApiError> {
        let job = self.store.job(JobId(id)).await?;
        if job.kind != JobKind::Evaluate.as_str() {
            return Err(ApiError::not_found("evaluation", id));
        }
        // The run may have been deleted separately.
        self.store.run_of_job(job.id).await?;
        let completed = self.complete_evaluations(vec![job]).await?.pop();
        let mut evaluation = completed.ok_or_else(|| ApiError::not_found("evaluation", id))?;
        evaluation.report = self.report(evaluation.run).await?;
        Ok(evaluation)
    }

    pub async fn evaluations(&self, request: &ListRequest) -> Result<Evaluations, ApiError> {
        let mut listed = self.store.list_jobs(&request.listing).await?;
        let specs = listed.items.iter().map(|row| &row.spec);
        if let Some(shorter) = request.shorter(specs) {
            listed = self.store.list_jobs(&shorter).await?;
        }
        let Listed { items, end } = listed;
        let evaluations = self.complete_evaluations(items).await?;
        Ok(Evaluations { evaluations, next: request.next(end) })
    }

    /// The report of a run's job. `None` before its last task has ended, and for the report of
    /// another version.
    ///
    /// # Errors
    /// [`ApiError::Damaged`] when the file is damaged.
    pub async fn report<T: DeserializeOwned>(&self, run: i64) -> Result<Option<T>, ApiError> {
        let artifacts = self.store.artifacts_named(&[RunId(run)], REPORT).await?;
        match artifacts.first() {
            Some(artifact) => self.read_report(artifact).await,
            None => Ok(None),
        }
    }

    /// The report files of `runs`, by run.
    pub async fn report_files(&self, runs: &[i64]) -> Result<BTreeMap<i64, Artifact>, ApiError> {
        let runs: Vec<RunId> = runs.iter().copied().map(RunId).collect();
        let artifacts = self.store.artifacts_named(&runs, REPORT).await?;
        Ok(artifacts.into_iter().map(|artifact| (artifact.run.0, artifact)).collect())
    }

    /// # Errors
    /// Like [`App::report`].
    pub async fn read_report<T: DeserializeOwned>(
        &self,
        artifact: &Artifact,
    ) -> Result<Option<T>, ApiError> {
        let file = || format!("{} of run {}", artifact.name, artifact.run);
        let bytes = self.store.read_object(&artifact.object).await;
        let bytes = bytes.map_err(|error| ApiError::reading(file(), error))?;
        Ok(serde_json::from_slice(&bytes).ok())
    }

    /// Adds data from other tables to the jobs of evaluations. The number of statements does not
    /// depend on the number of jobs.
    async fn complete_evaluations(
        &self,
        jobs: Vec<store::Job>,
    ) -> Result<Vec<Evaluation>, ApiError> {
        let ids: Vec<JobId> = jobs.iter().map(|job| job.id).collect();
        let runs: Vec<RunId> = jobs.iter().filter_map(|job| job.run).collect();
        let mut cells: HashMap<JobId, Vec<CellTask>> = HashMap::new();
        for task in self.store.tasks_of_stage(&ids, 0).await? {
            cells.entry(task.job).or_default().push(CellTask {
                task: task.id.0,
                label: task.label,
                state: task.state,
                error: task.error,
            });
        }
        let mut artifacts = self.artifacts(&runs).await?;
        let evaluation = |job: store::Job| {
            let run = job.run?;
            Some(Evaluation {
                cells: cells.remove(&job.id).unwrap_or_default(),
                artifacts: artifacts.remove(&run).unwrap_or_default(),
                id: job.id.0,
                run: run.0,
                name: job.name,
                note: job.note,
                tags: job.tags,
                digest: job.digest,
                state: job.state,
                error: job.error,
                spec: job.spec,
                report: None,
                created_at: job.created_at.to_string(),
            })
        };
        Ok(jobs.into_iter().filter_map(evaluation).collect())
    }
}
