//! Metrics of tracked runs, and batches of logged data.

use std::collections::{BTreeMap, BTreeSet};

use crate::boxed;
use crate::database::{Scope, Transaction, sql};
use crate::tracking::runs::active_run;
use crate::{Store, StoreError, Timestamp, TrackedRun, TrackedRunId};

/// A number that a client logged.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackedMetric {
    pub key: String,
    pub step: i64,
    /// The time that the client sent.
    pub time: Timestamp,
    /// May be NaN or infinite.
    pub value: f64,
}

/// Everything that one request logs to a run.
#[derive(Clone, Debug, Default)]
pub struct TrackedBatch {
    pub metrics: Vec<TrackedMetric>,
    pub params: Vec<(String, String)>,
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
        sql!(&mut tx, set_tracked_tags(run.id, &tags))?;
        sql!(&mut tx, insert_tracked_metrics(run.id, &batch.metrics))?;
        sql!(&mut tx, raise_latest(run.id, &latest(&batch.metrics)))?;
        if let Some(name) = batch.name.clone().filter(|name| *name != run.name) {
            sql!(&mut tx, update_tracked_run(&TrackedRun { name, ..run }))?;
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
        sql!(self.database(), READING, latest_tracked(runs, keys))
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
        sql!(self.database(), READING, tracked_history(run, key, skipped, limit))
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
    let logged = sql!(&mut *tx, params_of(run.id, &keys))?;
    for (key, value) in &logged {
        if let Some(new) = by_key.get(key.as_str()).filter(|new| *new != value) {
            return Err(changed(key, value, new));
        }
    }
    let known: BTreeSet<&str> = logged.iter().map(|(key, _)| key.as_str()).collect();
    let new = by_key.iter().filter(|(key, _)| !known.contains(*key));
    let new: Vec<(String, String)> =
        new.map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
    sql!(&mut *tx, add_tracked_params(run.id, &new))
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
