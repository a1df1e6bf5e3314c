//! Runs: the records of trainings and evaluations.

use std::collections::BTreeMap;

use figures::Figure;
use serde::Serialize;
use serde_json::Value;
use spec::{Digest, JobKind, JobSpec};
use store::{JobId, JobState, RunId, SeriesPoint};
use utoipa::ToSchema;

use crate::app::files::Download;
use crate::app::{App, Paging};
use crate::charts::loss_figure;
use crate::error::ApiError;
use crate::limits::POINTS_DEFAULT;

/// The record of a training or an evaluation.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Run {
    pub id: i64,
    pub job: i64,
    pub kind: JobKind,
    pub name: String,
    pub digest: Digest,
    #[schema(value_type = String, example = "running")]
    pub state: JobState,
    pub error: Option<String>,
    #[schema(value_type = JobSpec)]
    pub spec: Value,
    /// The latest value of each, by key.
    pub metrics: BTreeMap<String, LatestMetric>,
    pub artifacts: Vec<Artifact>,
    pub created_at: String,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct LatestMetric {
    pub step: u64,
    /// `null` when it was not a finite number.
    #[schema(value_type = Option<f64>)]
    pub value: f64,
}

/// A file that a run left.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Artifact {
    pub name: String,
    pub media_type: String,
    /// In bytes.
    pub size: u64,
    pub sha256: Digest,
    /// Path of the download.
    pub url: String,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Runs {
    pub runs: Vec<Run>,
    /// The `before` of the following page.
    pub next: Option<i64>,
}

/// A metric over steps, thinned out to the points asked for.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Metric {
    pub key: String,
    /// By step.
    pub points: Vec<MetricPoint>,
    /// Points before thinning out.
    pub recorded: u64,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct MetricPoint {
    pub step: u64,
    pub time: String,
    /// `null` when it was not a finite number.
    #[schema(value_type = Option<f64>)]
    pub value: f64,
}

impl App {
    pub async fn run(&self, id: i64) -> Result<Run, ApiError> {
        let row = self.store.run(RunId(id)).await?;
        self.complete_run(row).await
    }

    pub async fn runs(&self, paging: Paging) -> Result<Runs, ApiError> {
        let rows = self.store.runs(None, paging.into()).await?;
        let next = paging.next(rows.len(), rows.last().map(|row| row.id.0));
        let mut runs = Vec::with_capacity(rows.len());
        for row in rows {
            runs.push(self.complete_run(row).await?);
        }
        Ok(Runs { runs, next })
    }

    pub async fn metric(&self, run: i64, key: &str, points: u32) -> Result<Metric, ApiError> {
        let run = self.store.run(RunId(run)).await?.id;
        let series = self.store.series(run, key, points).await?;
        if series.points.is_empty() {
            return Err(ApiError::not_found("metric", format!("{key:?} of run {run}")));
        }
        Ok(Metric {
            key: series.key,
            points: series.points.iter().map(MetricPoint::from).collect(),
            recorded: series.recorded,
        })
    }

    /// The value that a job's run recorded last under `key`.
    pub async fn latest_metric_of_job(
        &self,
        job: i64,
        key: &str,
    ) -> Result<Option<LatestMetric>, ApiError> {
        let Some(run) = self.store.job(JobId(job)).await?.run else { return Ok(None) };
        let latest = self.store.latest_metrics(&[run]).await?;
        Ok(latest
            .into_iter()
            .find(|(_, found, _)| found == key)
            .map(|(_, _, point)| LatestMetric { step: point.step, value: point.value }))
    }

    pub async fn run_artifact(&self, run: i64, name: &str) -> Result<Download, ApiError> {
        let artifact = self.store.artifact(RunId(run), name).await?;
        let name = format!("run-{run}-{name}");
        Ok(Download::new(name, &artifact.media_type, &artifact.object))
    }

    /// Training and validation loss of a run so far.
    pub async fn loss_figure(&self, run: i64) -> Result<Figure, ApiError> {
        let run = self.store.run(RunId(run)).await?.id;
        let training = self.store.series(run, "train/loss", POINTS_DEFAULT).await?;
        let validation = self.store.series(run, "validation/loss", POINTS_DEFAULT).await?;
        Ok(loss_figure(&training.points, &validation.points))
    }

    pub(super) async fn artifacts(&self, run: RunId) -> Result<Vec<Artifact>, ApiError> {
        let rows = self.store.artifacts(run).await?;
        let artifact = |row: store::Artifact| Artifact {
            url: format!("/v1/runs/{run}/artifacts/{}", row.name),
            name: row.name,
            media_type: row.media_type,
            size: row.object.size,
            sha256: row.object.sha256,
        };
        Ok(rows.into_iter().map(artifact).collect())
    }

    async fn complete_run(&self, row: store::Run) -> Result<Run, ApiError> {
        let latest = self.store.latest_metrics(&[row.id]).await?;
        let metrics = latest
            .into_iter()
            .map(|(_, key, point)| (key, LatestMetric { step: point.step, value: point.value }));
        Ok(Run {
            metrics: metrics.collect(),
            artifacts: self.artifacts(row.id).await?,
            id: row.id.0,
            job: row.job.0,
            kind: row.kind.parse()?,
            name: row.name,
            digest: row.digest,
            state: row.state,
            error: row.error,
            spec: row.spec,
            created_at: row.created_at.to_string(),
        })
    }
}

impl From<&SeriesPoint> for MetricPoint {
    fn from(point: &SeriesPoint) -> Self {
        Self { step: point.step, time: point.time.to_string(), value: point.value }
    }
}
