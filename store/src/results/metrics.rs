//! Metrics: numbers of a run over its steps.
//!
//! A curve is drawn from the lowest and the highest point of every 64 steps (`metric_extremes`).
//! They are written in the transaction that records, replaces or deletes points. So a curve of a
//! million points costs its reader a few thousand rows.

use std::collections::BTreeMap;

use serde_json::json;

use crate::boxed;
use crate::database::patience::patiently;
use crate::database::{Scope, sql};
use crate::events::tell;
use crate::queue::leases;
use crate::{EventKind, Fence, RunId, Store, StoreError, Timestamp};

/// A number to record.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// E.g. `train/loss`.
    pub key: String,
    pub step: u64,
    /// May be NaN, e.g. the loss of a training that diverged.
    pub value: f64,
}

/// A metric over steps, downsampled for drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct MetricCurve {
    pub key: String,
    /// Sorted by step.
    pub points: Vec<CurvePoint>,
    /// Number of points recorded.
    pub recorded: u64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    pub step: u64,
    pub time: Timestamp,
    pub value: f64,
}

impl Store {
    /// Records metrics of the run of the fence's job. A value of a step that was recorded before is
    /// replaced, because a resumed training repeats that step.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn record_metrics(&self, fence: Fence, metrics: &[Metric]) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Rows, "recording metrics").await?;
            let (job, run) = leases::held_run(&mut tx, fence).await?;
            // If a key has several values at a step, the last one counts.
            let by_key: BTreeMap<(&str, u64), f64> = metrics
                .iter()
                .map(|metric| ((metric.key.as_str(), metric.step), metric.value))
                .collect();
            let rows: Vec<_> =
                by_key.iter().map(|((key, step), value)| (*key, *step, *value)).collect();
            sql!(&mut tx, insert_metrics(run, &rows))?;
            for same_key in rows.chunk_by(|(a, ..), (b, ..)| a == b) {
                let ((key, first, _), (_, last, _)) = (same_key[0], same_key[same_key.len() - 1]);
                sql!(&mut tx, set_latest(run, key))?;
                sql!(&mut tx, set_extremes(run, key, first, last))?;
            }
            if let Some(step) = metrics.iter().map(|metric| metric.step).max() {
                let data = json!({"run": run, "step": step});
                tell(&mut tx, EventKind::Metrics, job, &data).await?;
            }
            tx.commit().await
        })
    }

    /// Deletes values after `step`. A training that resumes from `step` calls this.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn delete_metrics_after(&self, fence: Fence, step: u64) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Rows, "deleting metrics").await?;
            let (_, run) = leases::held_run(&mut tx, fence).await?;
            for key in sql!(&mut tx, delete_metrics_after(run, step))? {
                sql!(&mut tx, set_latest(run, &key))?;
                sql!(&mut tx, delete_extremes_from(run, &key, step))?;
                sql!(&mut tx, set_extremes(run, &key, step, step))?;
            }
            tx.commit().await
        })
    }

    /// The value at the last step of every key of each run, sorted by run and key.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn latest_metrics(
        &self,
        runs: &[RunId],
    ) -> Result<Vec<(RunId, String, CurvePoint)>, StoreError> {
        sql!(self.database(), "reading the latest metrics", latest_metrics(runs))
    }

    /// For each run, the value of one key at its last step. Runs without the key are left out.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn latest_values(
        &self,
        runs: &[RunId],
        key: &str,
    ) -> Result<Vec<(RunId, CurvePoint)>, StoreError> {
        sql!(self.database(), "reading the latest metrics", latest_values(runs, key))
    }

    /// Points of a metric, sorted by step and not downsampled: `limit` after the first `skipped`.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn points_after(
        &self,
        run: RunId,
        key: &str,
        skipped: u64,
        limit: u32,
    ) -> Result<Vec<CurvePoint>, StoreError> {
        sql!(self.database(), "reading a metric", points_after(run, key, skipped, limit))
    }

    /// A metric in at most `points` points. If it has more, the result has the lowest and the
    /// highest value of each of `points / 2` ranges of steps, so no spike is lost. The ranges of a
    /// long metric are made of whole spans with known extremes; it may then have half as many
    /// points.
    ///
    /// # Errors
    /// When the database fails. A key that was never recorded has no points.
    #[boxed]
    pub async fn metric_curve(
        &self,
        run: RunId,
        key: &str,
        points: u32,
    ) -> Result<MetricCurve, StoreError> {
        const OPERATION: &str = "reading a metric";
        let (recorded, spans) = sql!(self.database(), OPERATION, recorded_points(run, key))?;
        let ranges = (points / 2).max(1);
        let points = if recorded <= u64::from(points) {
            sql!(self.database(), OPERATION, all_points(run, key))?
        } else if spans >= u64::from(ranges / 2) {
            sql!(self.database(), OPERATION, extremes_of_spans(run, key, ranges))?
        } else {
            sql!(self.database(), OPERATION, extreme_points(run, key, ranges))?
        };
        Ok(MetricCurve { key: key.to_owned(), points, recorded })
    }
}
