//! Metrics: numbers of a run over its steps.
//!
//! A curve is drawn from the lowest and the highest point of every 64 steps (`metric_extremes`).
//! They are written in the transaction that records, replaces or deletes points. So a curve of a
//! million points costs its reader a few thousand rows.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::json;

use crate::database::column::json;
use crate::database::patience::patiently;
use crate::database::query::{FromRow, Row, sql};
use crate::database::{Reading, Scope, Transaction};
use crate::events::tell;
use crate::queue::fences;
use crate::{EventKind, Fence, RunId, Store, StoreError, Timestamp, boxed};

/// A number to record.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// E.g. `train/loss`.
    pub key: String,
    /// The training step that it belongs to.
    pub step: u64,
    /// May be NaN, e.g. the loss of a training that diverged.
    pub value: f64,
}

/// A metric over steps, downsampled for drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct MetricCurve {
    /// Its name.
    pub key: String,
    /// Sorted by step.
    pub points: Vec<CurvePoint>,
    /// Number of points recorded.
    pub recorded: u64,
}

/// A point of a curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    /// The training step.
    pub step: u64,
    /// When the point was recorded.
    pub time: Timestamp,
    /// The value; NaN if it was not a number.
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
            let (job, run) = fences::held_run(&mut tx, fence).await?;
            // If a key has several values at a step, the last one counts.
            let by_key: BTreeMap<(&str, u64), f64> = metrics
                .iter()
                .map(|metric| ((metric.key.as_str(), metric.step), metric.value))
                .collect();
            let rows: Vec<_> =
                by_key.iter().map(|((key, step), value)| (*key, *step, *value)).collect();
            tx.insert_metrics(run, &rows).await?;
            for same_key in rows.chunk_by(|(a, ..), (b, ..)| a == b) {
                let ((key, first, _), (_, last, _)) = (same_key[0], same_key[same_key.len() - 1]);
                tx.set_latest(run, key).await?;
                tx.set_extremes(run, key, first, last).await?;
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
            let (_, run) = fences::held_run(&mut tx, fence).await?;
            for key in tx.delete_metrics_after(run, step).await? {
                tx.set_latest(run, &key).await?;
                tx.delete_extremes_from(run, &key, step).await?;
                tx.set_extremes(run, &key, step, step).await?;
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
        let rows =
            sql("SELECT run, key, step, time, value FROM metric_latest WHERE run IN {ids $1} \
             ORDER BY run, key")
            .bind(json(&runs))
            .rows(&mut self.read("reading the latest metrics"))
            .await?;
        rows.iter()
            .map(|row| Ok((row.get("run")?, row.get("key")?, CurvePoint::from_row(row)?)))
            .collect()
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
        let rows = sql(
            "SELECT run, step, time, value FROM metric_latest WHERE run IN {ids $1} AND key = $2 \
             ORDER BY run",
        )
        .bind(json(&runs))
        .bind(key)
        .rows(&mut self.read("reading the latest metrics"))
        .await?;
        rows.iter().map(|row| Ok((row.get("run")?, CurvePoint::from_row(row)?))).collect()
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
        sql("SELECT step, time, value FROM metric WHERE run = $1 AND key = $2 ORDER BY step \
             LIMIT $3 OFFSET $4")
        .bind(run)
        .bind(key)
        .bind(limit)
        .bind(skipped)
        .all(&mut self.read("reading a metric"))
        .await
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
        let (recorded, spans) = self.read(OPERATION).recorded_points(run, key).await?;
        let ranges = (points / 2).max(1);
        let points = if recorded <= u64::from(points) {
            self.read(OPERATION).all_points(run, key).await?
        } else if spans >= u64::from(ranges / 2) {
            self.read(OPERATION).extremes_of_spans(run, key, ranges).await?
        } else {
            extremes(&self.read(OPERATION).all_points(run, key).await?, ranges)
        };
        Ok(MetricCurve { key: key.to_owned(), points, recorded })
    }
}

/// Rows per statement, with four values each. SQLite binds 32 766 values at most, PostgreSQL 65
/// 535.
const ROWS_PER_STATEMENT: usize = 4000;

/// Number of steps whose lowest and highest points are kept together. Rows of existing databases
/// depend on it.
const SPAN: u64 = 64;

impl Reading<'_> {
    /// Number of points of a metric, and number of spans that have points.
    pub async fn recorded_points(
        &mut self,
        run: RunId,
        key: &str,
    ) -> Result<(u64, u64), StoreError> {
        let (points, spans): (i64, i64) =
            sql("SELECT CAST(COALESCE(SUM(points), 0) AS BIGINT), COUNT(*) FROM metric_extremes \
             WHERE run = $1 AND key = $2")
            .bind(run)
            .bind(key)
            .one(self)
            .await?;
        Ok((points.unsigned_abs(), spans.unsigned_abs()))
    }

    /// Sorted by step.
    pub async fn all_points(
        &mut self,
        run: RunId,
        key: &str,
    ) -> Result<Vec<CurvePoint>, StoreError> {
        sql("SELECT step, time, value FROM metric WHERE run = $1 AND key = $2 ORDER BY step")
            .bind(run)
            .bind(key)
            .all(self)
            .await
    }

    /// The lowest and the highest point of each of `ranges` ranges of spans, sorted by step.
    pub async fn extremes_of_spans(
        &mut self,
        run: RunId,
        key: &str,
        ranges: u32,
    ) -> Result<Vec<CurvePoint>, StoreError> {
        sql(
            "WITH bound AS MATERIALIZED (SELECT MIN(span) AS first, MAX(span) AS last \
                            FROM metric_extremes WHERE run = $1 AND key = $2), \
             parted AS (SELECT low_step, low_time, low_value, high_step, high_time, high_value, \
                        (span - first) * $3 / (last - first + 1) AS part \
                        FROM metric_extremes, bound WHERE run = $1 AND key = $2), \
             ranked AS MATERIALIZED (SELECT low_step, low_time, low_value, high_step, high_time, high_value, \
                ROW_NUMBER() OVER (PARTITION BY part ORDER BY low_value NULLS FIRST, low_step) AS from_lowest, \
                ROW_NUMBER() OVER (PARTITION BY part ORDER BY high_value DESC NULLS LAST, high_step) \
                    AS from_highest \
                FROM parted) \
             SELECT low_step AS step, low_time AS time, low_value AS value FROM ranked WHERE from_lowest = 1 \
             UNION \
             SELECT high_step, high_time, high_value FROM ranked WHERE from_highest = 1 ORDER BY step",
        )
        .bind(run)
        .bind(key)
        .bind(ranges)
        .all(self)
        .await
    }
}

/// The lowest and the highest point of each of `ranges` equal ranges of steps. NaN is below all numbers.
fn extremes(points: &[CurvePoint], ranges: u32) -> Vec<CurvePoint> {
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return Vec::new() };
    let steps = u128::from(last.step - first.step) + 1;
    let range =
        |point: &CurvePoint| u128::from(point.step - first.step) * u128::from(ranges) / steps;
    let order = |a: &CurvePoint, b: &CurvePoint| {
        b.value.is_nan().cmp(&a.value.is_nan()).then(a.value.total_cmp(&b.value))
    };
    let of_range = |points: &[CurvePoint]| {
        let ends = 0..points.len();
        let lowest = ends.clone().min_by(|a, b| order(&points[*a], &points[*b]));
        // The first of several equal points counts.
        let highest = ends.rev().max_by(|a, b| order(&points[*a], &points[*b]));
        let places: BTreeSet<usize> = lowest.into_iter().chain(highest).collect();
        places.into_iter().map(|place| points[place]).collect::<Vec<_>>()
    };
    points.chunk_by(|a, b| range(a) == range(b)).flat_map(of_range).collect()
}

impl Transaction {
    /// Inserts key, step and value of each metric, and replaces values at the same steps. No key
    /// may have a step twice.
    pub async fn insert_metrics(
        &mut self,
        run: RunId,
        metrics: &[(&str, u64, f64)],
    ) -> Result<(), StoreError> {
        for part in metrics.chunks(ROWS_PER_STATEMENT) {
            let mut query = sql("INSERT INTO metric (run, key, step, time, value) ");
            query.push_values(part, |row, (key, step, value)| {
                row.push_bind(run)
                    .push_bind((*key).to_owned())
                    .push_bind(*step)
                    .push("{now}")
                    .push_bind(Some(*value).filter(|value| !value.is_nan()));
            });
            query.push(
                " ON CONFLICT (run, key, step) DO UPDATE SET time = excluded.time, \
                 value = excluded.value",
            );
            // Batches differ in length, so each statement is a different one. Keeping them would
            // only fill the cache.
            query.persistent(false).changed(self).await?;
        }
        Ok(())
    }

    /// Updates the latest value of a key.
    pub async fn set_latest(&mut self, run: RunId, key: &str) -> Result<(), StoreError> {
        sql("INSERT INTO metric_latest (run, key, step, time, value) \
             SELECT run, key, step, time, value FROM metric WHERE run = $1 AND key = $2 \
             ORDER BY step DESC LIMIT 1 \
             ON CONFLICT (run, key) DO UPDATE SET step = excluded.step, time = excluded.time, \
             value = excluded.value")
        .bind(run)
        .bind(key)
        .run(self)
        .await
    }

    /// Updates the extremes of the spans from the step `first` to `last`. Spans without points stay
    /// as they are.
    pub async fn set_extremes(
        &mut self,
        run: RunId,
        key: &str,
        first: u64,
        last: u64,
    ) -> Result<(), StoreError> {
        sql(
            "INSERT INTO metric_extremes (run, key, span, points, low_step, low_time, low_value, \
                high_step, high_time, high_value) \
             SELECT run, key, span, COUNT(*), MAX(CASE WHEN from_lowest = 1 THEN step END), \
                MAX(CASE WHEN from_lowest = 1 THEN time END), MAX(CASE WHEN from_lowest = 1 THEN value END), \
                MAX(CASE WHEN from_highest = 1 THEN step END), MAX(CASE WHEN from_highest = 1 THEN time END), \
                MAX(CASE WHEN from_highest = 1 THEN value END) \
             FROM (SELECT run, key, step / $5 AS span, step, time, value, \
                ROW_NUMBER() OVER (PARTITION BY step / $5 ORDER BY value NULLS FIRST, step) AS from_lowest, \
                ROW_NUMBER() OVER (PARTITION BY step / $5 ORDER BY value DESC NULLS LAST, step) AS from_highest \
                FROM metric WHERE run = $1 AND key = $2 AND step BETWEEN $3 AND $4) AS ranked \
             WHERE TRUE GROUP BY run, key, span \
             ON CONFLICT (run, key, span) DO UPDATE SET points = excluded.points, \
                low_step = excluded.low_step, low_time = excluded.low_time, low_value = excluded.low_value, \
                high_step = excluded.high_step, high_time = excluded.high_time, high_value = excluded.high_value",
        )
        .bind(run)
        .bind(key)
        .bind(first - first % SPAN)
        .bind(last - last % SPAN + (SPAN - 1))
        .bind(SPAN).run(self).await
    }

    /// Deletes the extremes of the span of `step` and of all later spans.
    pub async fn delete_extremes_from(
        &mut self,
        run: RunId,
        key: &str,
        step: u64,
    ) -> Result<(), StoreError> {
        sql("DELETE FROM metric_extremes WHERE run = $1 AND key = $2 AND span >= $3")
            .bind(run)
            .bind(key)
            .bind(step / SPAN)
            .run(self)
            .await
    }

    /// Returns the keys whose latest value was deleted.
    pub async fn delete_metrics_after(
        &mut self,
        run: RunId,
        step: u64,
    ) -> Result<Vec<String>, StoreError> {
        sql("DELETE FROM metric WHERE run = $1 AND step > $2")
            .bind(run)
            .bind(step)
            .changed(self)
            .await?;
        sql("DELETE FROM metric_latest WHERE run = $1 AND step > $2 RETURNING key")
            .bind(run)
            .bind(step)
            .all(self)
            .await
    }
}

impl FromRow for CurvePoint {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        // SQLite has no NaN. It is stored as NULL.
        let value: Option<f64> = row.get("value")?;
        Ok(Self {
            step: row.get("step")?,
            time: row.get("time")?,
            value: value.unwrap_or(f64::NAN),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_range_keeps_its_lowest_and_its_highest_point() {
        let values = [1.0, 5.0, 3.0, 3.0, f64::NAN, 2.0, 7.0, 7.0, 4.0];
        let point = |(step, value): (u64, &f64)| CurvePoint {
            step,
            time: Timestamp::from_milliseconds(0),
            value: *value,
        };
        let points: Vec<CurvePoint> = (10..).zip(&values).map(point).collect();
        let steps = |ranges: u32| -> Vec<u64> {
            extremes(&points, ranges).iter().map(|point| point.step).collect()
        };
        // NaN is the lowest, and of equal points the first one counts.
        assert_eq!(steps(1), [14, 16]);
        assert_eq!(steps(3), [10, 11, 13, 14, 16, 18]);
        assert_eq!(steps(100), (10..19).collect::<Vec<u64>>());
        assert!(extremes(&[], 3).is_empty());
    }
}
