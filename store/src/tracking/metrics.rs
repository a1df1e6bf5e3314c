//! Metrics of tracked runs, and batches of logged data.

use std::collections::{BTreeMap, BTreeSet};

use crate::database::query::{FromRow, Query, Row, sql};
use crate::database::{Scope, Transaction};
use crate::tracking::runs::active_run;
use crate::{Store, StoreError, Timestamp, TrackedRun, TrackedRunId, boxed};

/// A number that a client logged.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackedMetric {
    /// The name of the metric.
    pub key: String,
    /// The step that the client sent.
    pub step: i64,
    /// The time that the client sent.
    pub time: Timestamp,
    /// May be NaN or infinite.
    pub value: f64,
}

/// Everything that one request logs to a run.
#[derive(Clone, Debug, Default)]
pub struct TrackedBatch {
    /// Points of metrics.
    pub metrics: Vec<TrackedMetric>,
    /// Parameters, as keys and values.
    pub params: Vec<(String, String)>,
    /// Tags, as keys and values.
    pub tags: Vec<(String, String)>,
    /// The run's new name.
    pub name: Option<String>,
}

const READING: &str = "reading metrics of tracked runs";

impl Store {
    /// Logs a whole batch, or nothing. A point that exists is not logged again.
    ///
    /// # Errors
    /// When there is no such run or it is deleted. [`StoreError::ParamChanged`] when a param
    /// already has another value.
    #[boxed]
    pub async fn log_batch(&self, run: &str, batch: &TrackedBatch) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "logging to a tracked run").await?;
        let run = active_run(&mut tx, run).await?;
        log_params(&mut tx, &run, &batch.params).await?;
        let tags: BTreeMap<_, _> = batch.tags.iter().cloned().collect();
        let tags: Vec<(String, String)> = tags.into_iter().collect();
        tx.set_tracked_tags(run.id, &tags).await?;
        tx.insert_tracked_metrics(run.id, &batch.metrics).await?;
        tx.raise_latest(run.id, &latest(&batch.metrics)).await?;
        if let Some(name) = batch.name.clone().filter(|name| *name != run.name) {
            tx.update_tracked_run(&TrackedRun { name, ..run }).await?;
        }
        tx.commit().await
    }

    /// The latest point of each key of `runs`, or only of `keys`, sorted by run and key. The latest
    /// point has the highest step, then the latest time, then the highest value.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn latest_tracked(
        &self,
        runs: &[TrackedRunId],
        keys: Option<&[String]>,
    ) -> Result<Vec<(TrackedRunId, TrackedMetric)>, StoreError> {
        let mut query = sql(
            "SELECT run, key, step, time, value, is_nan FROM tracked_metric_latest WHERE run IN ",
        );
        query.push_ids(&runs);
        if let Some(keys) = keys {
            query.push(" AND key IN ").push_texts(&keys);
        }
        query.push(" ORDER BY run, key");
        let rows = query.rows(&mut self.read(READING)).await?;
        rows.iter().map(|row| Ok((row.get("run")?, TrackedMetric::from_row(row)?))).collect()
    }

    /// Points of a key, sorted by step, time and value: `limit` after the first `skipped`.
    ///
    /// # Errors
    /// When the database fails. A key that was never logged has no points.
    #[boxed]
    pub async fn tracked_history(
        &self,
        run: TrackedRunId,
        key: &str,
        skipped: u64,
        limit: u32,
    ) -> Result<Vec<TrackedMetric>, StoreError> {
        sql(
            "SELECT key, step, time, value, is_nan FROM tracked_metric WHERE run = $1 AND key = $2 \
             ORDER BY step, time, value, is_nan LIMIT $3 OFFSET $4",
        )
        .bind(run)
        .bind(key)
        .bind(limit)
        .bind(skipped)
        .all(&mut self.read(READING))
        .await
    }
}

/// Params keep their first value.
async fn log_params(
    tx: &mut Transaction,
    run: &TrackedRun,
    params: &[(String, String)],
) -> Result<(), StoreError> {
    let changed = |key: &str, logged: &str, new: &str| StoreError::ParamChanged {
        run: run.identifier.clone(),
        key: key.to_owned(),
        logged: logged.to_owned(),
        new: new.to_owned(),
    };
    let mut by_key: BTreeMap<&str, &str> = BTreeMap::new();
    for (key, value) in params {
        if let Some(first) = by_key.insert(key, value).filter(|first| first != value) {
            return Err(changed(key, first, value));
        }
    }
    if by_key.is_empty() {
        return Ok(());
    }
    let keys: Vec<&str> = by_key.keys().copied().collect();
    let logged = tx.params_of(run.id, &keys).await?;
    for (key, value) in &logged {
        if let Some(new) = by_key.get(key.as_str()).filter(|new| *new != value) {
            return Err(changed(key, value, new));
        }
    }
    let known: BTreeSet<&str> = logged.iter().map(|(key, _)| key.as_str()).collect();
    let new = by_key.iter().filter(|(key, _)| !known.contains(*key));
    let new: Vec<(String, String)> =
        new.map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
    tx.add_tracked_params(run.id, &new).await
}

/// The latest metric of each key, sorted by key.
fn latest(metrics: &[TrackedMetric]) -> Vec<TrackedMetric> {
    let mut latest: BTreeMap<&str, &TrackedMetric> = BTreeMap::new();
    for metric in metrics {
        let kept = latest.entry(&metric.key).or_insert(metric);
        if metric.is_later_than(kept) {
            *kept = metric;
        }
    }
    latest.into_values().cloned().collect()
}

impl TrackedMetric {
    /// The value as stored. NaN is stored as 0, as MLflow's own server does.
    pub(crate) fn stored_value(&self) -> f64 {
        if self.value.is_nan() { 0.0 } else { self.value }
    }

    fn is_later_than(&self, other: &Self) -> bool {
        let moment = |metric: &Self| (metric.step, metric.time);
        moment(self)
            .cmp(&moment(other))
            .then(self.stored_value().total_cmp(&other.stored_value()))
            .is_gt()
    }
}

/// Rows per statement, with six values each. SQLite binds 32 766 values at most, PostgreSQL 65 535.
/// A batch of MLflow has 1000 rows.
const ROWS_PER_STATEMENT: usize = 1000;

impl Transaction {
    /// Inserts points, and skips those that exist.
    pub async fn insert_tracked_metrics(
        &mut self,
        run: TrackedRunId,
        metrics: &[TrackedMetric],
    ) -> Result<(), StoreError> {
        for part in metrics.chunks(ROWS_PER_STATEMENT) {
            let mut query = points("tracked_metric", run, part);
            query.push(" ON CONFLICT DO NOTHING");
            // Batches differ in length, but all full ones are the same statement.
            let is_common = part.len() == ROWS_PER_STATEMENT;
            query.persistent(is_common).changed(self).await?;
        }
        Ok(())
    }

    /// Replaces latest points by later ones. No key may appear twice.
    pub async fn raise_latest(
        &mut self,
        run: TrackedRunId,
        metrics: &[TrackedMetric],
    ) -> Result<(), StoreError> {
        for part in metrics.chunks(ROWS_PER_STATEMENT) {
            let mut query = points("tracked_metric_latest", run, part);
            query.push(
                " ON CONFLICT (run, key) DO UPDATE SET step = excluded.step, \
                 time = excluded.time, value = excluded.value, is_nan = excluded.is_nan \
                 WHERE (excluded.step, excluded.time, excluded.value) > (tracked_metric_latest.step, \
                 tracked_metric_latest.time, tracked_metric_latest.value)",
            );
            query.persistent(part.len() == 1).changed(self).await?;
        }
        Ok(())
    }
}

fn points(table: &str, run: TrackedRunId, metrics: &[TrackedMetric]) -> Query {
    let insert = format!("INSERT INTO {table} (run, key, step, time, value, is_nan) ");
    let mut query = sql(insert);
    query.push_values(metrics, |row, metric| {
        row.push_bind(run)
            .push_bind(metric.key.clone())
            .push_bind(metric.step)
            .push_bind(metric.time)
            .push_bind(metric.stored_value())
            .push_bind(metric.value.is_nan());
    });
    query
}

impl FromRow for TrackedMetric {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        let is_nan: bool = row.get("is_nan")?;
        let value: f64 = row.get("value")?;
        Ok(Self {
            key: row.get("key")?,
            step: row.get("step")?,
            time: row.get("time")?,
            value: if is_nan { f64::NAN } else { value },
        })
    }
}
