//! Runs: the records of trainings and evaluations.

use figures::Figure;
use store::{JobId, RunId, SeriesPoint};
use wire::{Artifact, LatestMetric, Metric, MetricPoint, Run, Runs};

use crate::app::files::Download;
use crate::app::{App, Paging};
use crate::charts::loss_figure;
use crate::error::ApiError;
use crate::limits::POINTS_DEFAULT;

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
            points: series.points.iter().map(point).collect(),
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
        let recorded = self.store.latest_metrics(&[run]).await?;
        Ok(recorded
            .into_iter()
            .find(|(_, found, _)| found == key)
            .map(|(_, _, point)| latest(&point)))
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
        let recorded = self.store.latest_metrics(&[row.id]).await?;
        let metrics = recorded.into_iter().map(|(_, key, point)| (key, latest(&point)));
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

fn latest(point: &SeriesPoint) -> LatestMetric {
    LatestMetric { step: point.step, value: finite(point.value) }
}

fn point(point: &SeriesPoint) -> MetricPoint {
    MetricPoint { step: point.step, time: point.time.to_string(), value: finite(point.value) }
}

/// JSON has no other numbers.
fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}
