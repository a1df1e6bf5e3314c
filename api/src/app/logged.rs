//! Runs that clients of MLflow logged, for the page.

use std::collections::BTreeMap;

use store::{ExperimentId, TrackedArtifact, TrackedMetric, TrackedRun, TrackedRunId};

use crate::app::App;
use crate::error::ApiError;
use crate::limits::LOGGED_POINTS;

/// A run with the newest value of each of its metrics.
pub struct LoggedRun {
    pub run: TrackedRun,
    /// The name of its experiment.
    pub experiment: String,
    pub metrics: Vec<TrackedMetric>,
}

/// A run with everything that was logged.
pub struct WholeLoggedRun {
    pub logged: LoggedRun,
    pub params: Vec<(String, String)>,
    pub tags: Vec<(String, String)>,
    pub artifacts: Vec<TrackedArtifact>,
}

impl App {
    /// The names of all experiments that are not deleted, that of torqued's own runs among them.
    pub(crate) async fn experiment_names(
        &self,
    ) -> Result<BTreeMap<ExperimentId, String>, ApiError> {
        let experiments = self.store.tracked_experiments().await?;
        let there = experiments.into_iter().filter(|experiment| !experiment.is_deleted);
        Ok(there.map(|experiment| (experiment.id, experiment.name)).collect())
    }

    /// # Errors
    /// When no client logged a run with this identifier.
    pub(crate) async fn logged_run(&self, identifier: &str) -> Result<WholeLoggedRun, ApiError> {
        let run = self.store.tracked_run(identifier).await?;
        let ids = [run.id];
        let metrics = self.store.latest_tracked(&ids, None).await?;
        let pairs = |found: Vec<(TrackedRunId, String, String)>| {
            found.into_iter().map(|(_, key, value)| (key, value)).collect()
        };
        Ok(WholeLoggedRun {
            params: pairs(self.store.tracked_params(&ids, None).await?),
            tags: pairs(self.store.tracked_tags(&ids, None).await?),
            artifacts: self.store.tracked_artifacts(run.id).await?,
            logged: LoggedRun {
                experiment: self.store.experiment(run.experiment).await?.name,
                metrics: metrics.into_iter().map(|(_, metric)| metric).collect(),
                run,
            },
        })
    }

    /// The first points of a metric, by step, and whether there are more.
    pub(crate) async fn logged_points(
        &self,
        run: &TrackedRun,
        key: &str,
    ) -> Result<(Vec<TrackedMetric>, bool), ApiError> {
        let mut points = self.store.tracked_history(run.id, key, 0, LOGGED_POINTS + 1).await?;
        let has_more = points.len() > LOGGED_POINTS as usize;
        points.truncate(LOGGED_POINTS as usize);
        Ok((points, has_more))
    }
}
