//! The single predictions that evaluations drew.

use std::cmp::Reverse;

use spec::{DataSource, EvaluateSpec, JobKind, JobSpec};
use store::RunId;
use wire::{Checkpoint, DrawnPredictions, ItemKind, Job};

use crate::app::App;
use crate::error::ApiError;

/// The artifact that lists them.
const DRAWN: &str = "predictions.json";

/// Evaluations of a checkpoint looked through, the newest first.
const EVALUATIONS: usize = 20;

impl App {
    /// The predictions that the evaluation with this run drew; `None` of one that drew none, and where the list is damaged.
    pub(crate) async fn drawn_predictions(
        &self,
        run: i64,
    ) -> Result<Option<DrawnPredictions>, ApiError> {
        let artifacts = self.store.artifacts_named(&[RunId(run)], DRAWN).await?;
        let Some(artifact) = artifacts.first() else { return Ok(None) };
        match self.read_report(artifact).await {
            Err(error @ ApiError::Damaged { .. }) => {
                error.log();
                Ok(None)
            }
            drawn => drawn,
        }
    }

    /// The dataset of the newest evaluation that drew predictions of a checkpoint; `None` if it has none that is stored.
    pub(crate) async fn dataset_of_evaluation(
        &self,
        checkpoint: &Checkpoint,
    ) -> Result<Option<i64>, ApiError> {
        let Some((evaluation, _)) = self.drawn_of_checkpoint(checkpoint).await? else {
            return Ok(None);
        };
        match serde_json::from_value(evaluation.spec) {
            Ok(JobSpec::Evaluate(EvaluateSpec { data: DataSource::Digest(digest), .. })) => {
                self.dataset_of_digest(digest).await
            }
            _ => Ok(None),
        }
    }

    /// The newest evaluation that drew predictions of a checkpoint.
    pub(crate) async fn drawn_of_checkpoint(
        &self,
        checkpoint: &Checkpoint,
    ) -> Result<Option<(Job, DrawnPredictions)>, ApiError> {
        let readers = self.dependents(ItemKind::Checkpoint, checkpoint.id).await?.jobs;
        let mut ids: Vec<i64> = readers.iter().map(|reader| reader.id).collect();
        ids.sort_unstable_by_key(|id| Reverse(*id));
        ids.truncate(EVALUATIONS);
        let jobs = self.jobs_by_id(&ids).await?;
        for job in jobs.into_values().rev().filter(|job| job.kind == JobKind::Evaluate) {
            let Some(run) = job.run else { continue };
            let Some(drawn) = self.drawn_predictions(run).await? else { continue };
            if drawn.predictor_of(checkpoint).is_some() {
                return Ok(Some((job, drawn)));
            }
        }
        Ok(None)
    }
}
