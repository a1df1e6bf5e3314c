//! Single runs. Torqued's own can be read, and those of clients can also be written.

use store::{ExperimentId, NewTrackedRun, Timestamp, TrackedBatch, TrackedRun, TrackedRunChange};

use super::{RunName, artifact_uri, own_runs};
use crate::app::App;
use crate::mlflow::MlflowError;
use crate::mlflow::entities::{Metric, Run, RunInfo, Stage};
use crate::mlflow::limits::HISTORY_PAGE;

impl App {
    /// The default of `start_time` is the present.
    pub(crate) async fn create_tracked_run(
        &self,
        experiment: ExperimentId,
        name: Option<String>,
        user: String,
        start_time: Option<i64>,
        tags: Vec<(String, String)>,
    ) -> Result<Run, MlflowError> {
        let start_time = match start_time {
            Some(milliseconds) => Timestamp::from_milliseconds(milliseconds),
            None => self.store.now().await?,
        };
        let new = NewTrackedRun { experiment, name, user, start_time, tags };
        let run = self.store.create_tracked_run(&new).await?;
        self.mlflow_run(&RunName::Tracked(run.identifier)).await
    }

    /// The status and the end of torqued's own runs are those of their jobs, whatever a client says: one that sets a tag
    /// within `start_run` sets both along the way.
    pub(crate) async fn change_tracked_run(
        &self,
        run: &RunName,
        change: &TrackedRunChange,
    ) -> Result<RunInfo, MlflowError> {
        if let RunName::Own(id) = run {
            self.label_own_run(*id, change.name.clone(), &[]).await?;
            return Ok(own_runs::info(&(&self.store.run(*id).await?).into()));
        }
        Ok(info(&self.store.change_tracked_run(run.writable()?, change).await?))
    }

    pub(crate) async fn set_tracked_run_deleted(
        &self,
        run: &RunName,
        is_deleted: bool,
    ) -> Result<(), MlflowError> {
        let keep = is_deleted.then(|| self.options.keep_deleted);
        Ok(self.store.set_tracked_run_deleted(run.writable()?, keep).await?)
    }

    /// Torqued's own runs take the tags that are labels.
    pub(crate) async fn log_batch(
        &self,
        run: &RunName,
        batch: &TrackedBatch,
    ) -> Result<(), MlflowError> {
        if let RunName::Own(id) = run
            && batch.metrics.is_empty()
            && batch.params.is_empty()
        {
            return self.label_own_run(*id, None, &batch.tags).await;
        }
        Ok(self.store.log_batch(run.writable()?, batch).await?)
    }

    pub(crate) async fn delete_tracked_tag(
        &self,
        run: &RunName,
        key: &str,
    ) -> Result<(), MlflowError> {
        if let RunName::Own(id) = run {
            return self.delete_own_tag(*id, key).await;
        }
        Ok(self.store.delete_tracked_tag(run.writable()?, key).await?)
    }

    /// Points of a metric after the first `skipped`, and the token of the next page.
    pub(crate) async fn metric_history(
        &self,
        run: &RunName,
        key: &str,
        skipped: u64,
        limit: u32,
    ) -> Result<(Vec<Metric>, Option<String>), MlflowError> {
        let limit = limit.min(HISTORY_PAGE);
        // One point more than the limit tells whether there is another page.
        let mut points: Vec<Metric> = match run {
            RunName::Own(id) => {
                let run = self.store.run(*id).await?;
                let points = self.store.points_after(run.id, key, skipped, limit + 1).await?;
                points.iter().map(|point| own_metric(key.to_owned(), point)).collect()
            }
            RunName::Tracked(identifier) => {
                let run = self.store.tracked_run(identifier).await?;
                let points = self.store.tracked_history(run.id, key, skipped, limit + 1).await?;
                points.into_iter().map(tracked_metric).collect()
            }
        };
        let has_more = points.len() > usize::try_from(limit).unwrap_or(usize::MAX);
        points.truncate(usize::try_from(limit).unwrap_or(usize::MAX));
        let next = has_more.then(|| (skipped + u64::from(limit)).to_string());
        Ok((points, next))
    }
}

pub(super) fn info(run: &TrackedRun) -> RunInfo {
    let name = RunName::Tracked(run.identifier.clone());
    RunInfo {
        run_id: run.identifier.clone(),
        run_uuid: run.identifier.clone(),
        run_name: run.name.clone(),
        experiment_id: run.experiment.to_string(),
        user_id: run.user.clone(),
        status: run.status.as_str(),
        start_time: run.start_time.milliseconds(),
        end_time: run.end_time.map(Timestamp::milliseconds),
        artifact_uri: artifact_uri(run.experiment, &name),
        lifecycle_stage: Stage::of(run.is_deleted),
    }
}

pub(super) fn own_metric(key: String, point: &store::CurvePoint) -> Metric {
    Metric {
        key,
        value: point.value,
        timestamp: point.time.milliseconds(),
        step: i64::try_from(point.step).unwrap_or(i64::MAX),
    }
}

pub(super) fn tracked_metric(metric: store::TrackedMetric) -> Metric {
    Metric {
        key: metric.key,
        value: metric.value,
        timestamp: metric.time.milliseconds(),
        step: metric.step,
    }
}
