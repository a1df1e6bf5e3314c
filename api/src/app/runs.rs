//! Runs: the records of trainings and evaluations.

use std::collections::{BTreeMap, HashMap};

use serde_json::Value;
use spec::ValidationMetric;
use store::{CurvePoint, Listed, Listing, RunId, Store, StoreError};
use wire::{Artifact, LatestMetric, Metric, MetricPoint, Run};

use crate::app::App;
use crate::app::files::Download;
use crate::app::resources::Resource;
use crate::charts::TrainingCurves;
use crate::error::ApiError;
use crate::limits::POINTS_DEFAULT;

impl Resource for Run {
    type Row = store::Run;

    async fn rows(store: &Store, listing: &Listing) -> Result<Listed<Self::Row>, StoreError> {
        store.list_runs(listing).await
    }

    fn spec(row: &Self::Row) -> Option<&Value> {
        Some(&row.spec)
    }

    async fn complete(app: &App, rows: Vec<Self::Row>) -> Result<Vec<Self>, ApiError> {
        app.complete_runs(rows).await
    }

    async fn find(app: &App, id: i64) -> Result<Self, ApiError> {
        app.run(id).await
    }
}

impl App {
    pub(crate) async fn run(&self, id: i64) -> Result<Run, ApiError> {
        let row = self.store.run(RunId(id)).await?;
        self.complete_runs(vec![row]).await?.pop().ok_or(ApiError::Internal)
    }

    pub(crate) async fn metric(
        &self,
        run: i64,
        key: &str,
        points: u32,
    ) -> Result<Metric, ApiError> {
        let run = self.store.run(RunId(run)).await?.id;
        let curve = self.store.metric_curve(run, key, points).await?;
        if curve.points.is_empty() {
            return Err(ApiError::not_found("metric", format!("{key:?} of run {run}")));
        }
        Ok(Metric {
            key: curve.key,
            points: curve.points.iter().map(point).collect(),
            recorded: curve.recorded,
        })
    }

    /// The last recorded values of `runs` under `key`, by run.
    pub(crate) async fn latest_values(
        &self,
        runs: &[i64],
        key: &str,
    ) -> Result<BTreeMap<i64, LatestMetric>, ApiError> {
        let runs: Vec<RunId> = runs.iter().copied().map(RunId).collect();
        let recorded = self.store.latest_values(&runs, key).await?;
        Ok(recorded.into_iter().map(|(run, point)| (run.0, latest(&point))).collect())
    }

    pub(crate) async fn run_artifact(&self, run: i64, name: &str) -> Result<Download, ApiError> {
        let run = self.store.run(RunId(run)).await?.id;
        let artifact = self.store.artifact(run, name).await?;
        let file = format!("{name} of run {run}");
        let saved_as = format!("run-{run}-{name}");
        Ok(Download::new(saved_as, &artifact.media_type, &artifact.object, file))
    }

    /// The curves of a training so far.
    pub(crate) async fn training_curves(&self, run: i64) -> Result<TrainingCurves, ApiError> {
        let run = self.store.run(RunId(run)).await?.id;
        Ok(TrainingCurves {
            loss: self.curve(run, "train/loss").await?,
            validation_loss: self.curve(run, ValidationMetric::Loss.key()).await?,
            validation_rmse: self.curve(run, ValidationMetric::RmseDeg.key()).await?,
        })
    }

    /// The points of a metric. Empty for a run without it.
    pub(crate) async fn metric_points(
        &self,
        run: i64,
        key: &str,
    ) -> Result<Vec<CurvePoint>, ApiError> {
        self.curve(RunId(run), key).await
    }

    async fn curve(&self, run: RunId, key: &str) -> Result<Vec<CurvePoint>, ApiError> {
        Ok(self.store.metric_curve(run, key, POINTS_DEFAULT).await?.points)
    }

    /// The files of `runs`, by run.
    pub(super) async fn artifacts(
        &self,
        runs: &[RunId],
    ) -> Result<HashMap<RunId, Vec<Artifact>>, ApiError> {
        let mut artifacts: HashMap<RunId, Vec<Artifact>> = HashMap::new();
        for row in self.store.artifacts(runs).await? {
            artifacts.entry(row.run).or_default().push(Artifact {
                url: format!("/v1/runs/{}/artifacts/{}", row.run, row.name),
                name: row.name,
                media_type: row.media_type,
                size: row.object.size,
                sha256: row.object.sha256,
            });
        }
        Ok(artifacts)
    }

    /// Adds data from other tables to runs. The number of statements does not depend on the number
    /// of runs.
    async fn complete_runs(&self, rows: Vec<store::Run>) -> Result<Vec<Run>, ApiError> {
        let ids: Vec<RunId> = rows.iter().map(|row| row.id).collect();
        let mut metrics: HashMap<RunId, BTreeMap<String, LatestMetric>> = HashMap::new();
        for (run, key, point) in self.store.latest_metrics(&ids).await? {
            metrics.entry(run).or_default().insert(key, latest(&point));
        }
        let mut artifacts = self.artifacts(&ids).await?;
        let names = self.data_names(rows.iter().map(|row| &row.spec)).await?;
        let run = |row: store::Run| -> Result<Run, ApiError> {
            Ok(Run {
                metrics: metrics.remove(&row.id).unwrap_or_default(),
                artifacts: artifacts.remove(&row.id).unwrap_or_default(),
                id: row.id.0,
                job: row.job.0,
                kind: row.kind.parse()?,
                name: row.name,
                note: row.note,
                tags: row.tags,
                job_tags: row.job_tags,
                digest: row.digest,
                state: row.state,
                error: row.error,
                data: names.of(&row.spec),
                spec: row.spec,
                created_at: row.created_at.to_string(),
            })
        };
        rows.into_iter().map(run).collect()
    }
}

fn latest(point: &CurvePoint) -> LatestMetric {
    LatestMetric { step: point.step, value: finite(point.value) }
}

fn point(point: &CurvePoint) -> MetricPoint {
    MetricPoint { step: point.step, time: point.time.to_string(), value: finite(point.value) }
}

/// The value, if it is finite. JSON has no other numbers.
fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}
