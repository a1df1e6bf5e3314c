//! Evaluations: jobs that compare predictors, with their report.

use std::collections::{BTreeMap, HashMap};

use serde::Deserialize as _;
use serde::de::DeserializeOwned;
use serde_json::Value;
use spec::JobKind;
use store::{Artifact, JobId, Listed, Listing, RunId, Store, StoreError};
use wire::{CellTask, Evaluation, EvaluationResult, Headline, Report};

use crate::app::App;
use crate::app::resources::Resource;
use crate::error::ApiError;

/// The artifact of the last task of an evaluation or a control job.
const REPORT: &str = "report.json";

impl Resource for Evaluation {
    type Row = store::Job;

    async fn rows(store: &Store, listing: &Listing) -> Result<Listed<Self::Row>, StoreError> {
        store.list_jobs(listing).await
    }

    fn spec(row: &Self::Row) -> Option<&Value> {
        Some(&row.spec)
    }

    async fn complete(app: &App, rows: Vec<Self::Row>) -> Result<Vec<Self>, ApiError> {
        app.complete_evaluations(rows).await
    }

    async fn find(app: &App, id: i64) -> Result<Self, ApiError> {
        app.evaluation(id).await
    }
}

impl App {
    pub(crate) async fn evaluation(&self, id: i64) -> Result<Evaluation, ApiError> {
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

    /// The report of a run's job. `None` before its last task has ended, and for the report of
    /// another version.
    ///
    /// # Errors
    /// [`ApiError::Damaged`] when the file is damaged.
    pub(crate) async fn report<T: DeserializeOwned>(
        &self,
        run: i64,
    ) -> Result<Option<T>, ApiError> {
        let artifacts = self.store.artifacts_named(&[RunId(run)], REPORT).await?;
        match artifacts.first() {
            Some(artifact) => self.read_report(artifact).await,
            None => Ok(None),
        }
    }

    /// The report files of `runs`, by run.
    async fn report_files(&self, runs: &[i64]) -> Result<BTreeMap<i64, Artifact>, ApiError> {
        let runs: Vec<RunId> = runs.iter().copied().map(RunId).collect();
        let artifacts = self.store.artifacts_named(&runs, REPORT).await?;
        Ok(artifacts.into_iter().map(|artifact| (artifact.run.0, artifact)).collect())
    }

    /// The headlines of `evaluations`, which are pairs of job and run, by job. The number of
    /// statements does not depend on the number of evaluations.
    ///
    /// The result of an evaluation's last task is the headline. Evaluations of earlier versions have
    /// only the report, which is read for them.
    pub(crate) async fn evaluation_headlines(
        &self,
        evaluations: &[(i64, i64)],
    ) -> Result<BTreeMap<i64, Headline>, ApiError> {
        let jobs: Vec<i64> = evaluations.iter().map(|(job, _)| *job).collect();
        let results = self.sole_results(&jobs).await?;
        let left = |(job, result): (&i64, &Value)| {
            Some((*job, EvaluationResult::deserialize(result).ok()?.headline))
        };
        let mut headlines: BTreeMap<i64, Headline> = results.iter().filter_map(left).collect();
        let is_older = |(job, _): &&(i64, i64)| !headlines.contains_key(job);
        let older: BTreeMap<i64, i64> =
            evaluations.iter().filter(is_older).map(|(job, run)| (*run, *job)).collect();
        if !older.is_empty() {
            let runs: Vec<i64> = older.keys().copied().collect();
            for (run, file) in self.report_files(&runs).await? {
                let headline = self.headline_of_report(&file).await?;
                headlines.extend(headline.and_then(|headline| Some((*older.get(&run)?, headline))));
            }
        }
        Ok(headlines)
    }

    /// The headline of a report. A damaged report only affects its own page, and not every list with
    /// its job.
    async fn headline_of_report(&self, file: &Artifact) -> Result<Option<Headline>, ApiError> {
        match self.read_report::<Report>(file).await {
            Ok(report) => Ok(report.as_ref().map(Headline::of)),
            Err(error @ ApiError::Damaged { .. }) => {
                error.log();
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    /// # Errors
    /// Like [`App::report`].
    pub(crate) async fn read_report<T: DeserializeOwned>(
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
        let names = self.data_names(jobs.iter().map(|job| &job.spec)).await?;
        let with_run = |job: &store::Job| Some((job.id.0, job.run?.0));
        let mut headlines = self
            .evaluation_headlines(&jobs.iter().filter_map(with_run).collect::<Vec<_>>())
            .await?;
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
                headline: headlines.remove(&job.id.0),
                data: names.of(&job.spec),
                spec: job.spec,
                report: None,
                created_at: job.created_at.to_string(),
            })
        };
        Ok(jobs.into_iter().filter_map(evaluation).collect())
    }
}
