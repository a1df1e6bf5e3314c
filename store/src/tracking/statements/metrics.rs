use sqlx::types::Json;
use sqlx::{FromRow, QueryBuilder, Row};

use super::{Database, Db, DbRow, LISTED_IDS, LISTED_TEXTS, Transaction, integer};
use crate::{TrackedMetric, TrackedRunId};

/// Rows per statement, with six values each. SQLite binds 32 766 values at most, PostgreSQL 65 535.
/// A batch of MLflow has 1000 rows.
const ROWS_PER_STATEMENT: usize = 1000;

impl Database {
    pub async fn latest_tracked(
        &self,
        runs: &[TrackedRunId],
        keys: Option<&[String]>,
    ) -> Result<Vec<(TrackedRunId, TrackedMetric)>, sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(
            "SELECT run, key, step, time, value, is_nan FROM tracked_metric_latest WHERE run IN ",
        );
        query.push(LISTED_IDS.0).push_bind(Json(runs.to_vec())).push(LISTED_IDS.1);
        if let Some(keys) = keys {
            query.push(" AND key IN ").push(LISTED_TEXTS.0).push_bind(Json(keys.to_vec()));
            query.push(LISTED_TEXTS.1);
        }
        query.push(" ORDER BY run, key");
        let rows = query.build().fetch_all(&self.reader).await?;
        rows.iter().map(|row| Ok((row.try_get("run")?, TrackedMetric::from_row(row)?))).collect()
    }

    pub async fn tracked_history(
        &self,
        run: TrackedRunId,
        key: &str,
        skipped: u64,
        limit: u32,
    ) -> Result<Vec<TrackedMetric>, sqlx::Error> {
        sqlx::query_as(
            "SELECT key, step, time, value, is_nan FROM tracked_metric WHERE run = $1 AND key = $2 \
             ORDER BY step, time, value, is_nan LIMIT $3 OFFSET $4",
        )
        .bind(run)
        .bind(key)
        .bind(i64::from(limit))
        .bind(integer(skipped))
        .fetch_all(&self.reader)
        .await
    }
}

impl Transaction {
    /// Inserts points, and skips those that exist.
    pub async fn insert_tracked_metrics(
        &mut self,
        run: TrackedRunId,
        metrics: &[TrackedMetric],
    ) -> Result<(), sqlx::Error> {
        for part in metrics.chunks(ROWS_PER_STATEMENT) {
            let mut query = points("tracked_metric", run, part);
            query.push(" ON CONFLICT DO NOTHING");
            // Batches differ in length, but all full ones are the same statement.
            let is_common = part.len() == ROWS_PER_STATEMENT;
            query.build().persistent(is_common).execute(self.connection()).await?;
        }
        Ok(())
    }

    /// Replaces latest points by later ones. No key may appear twice.
    pub async fn raise_latest(
        &mut self,
        run: TrackedRunId,
        metrics: &[TrackedMetric],
    ) -> Result<(), sqlx::Error> {
        for part in metrics.chunks(ROWS_PER_STATEMENT) {
            let mut query = points("tracked_metric_latest", run, part);
            query.push(
                " ON CONFLICT (run, key) DO UPDATE SET step = excluded.step, \
                 time = excluded.time, value = excluded.value, is_nan = excluded.is_nan \
                 WHERE (excluded.step, excluded.time, excluded.value) > (tracked_metric_latest.step, \
                 tracked_metric_latest.time, tracked_metric_latest.value)",
            );
            query.build().persistent(part.len() == 1).execute(self.connection()).await?;
        }
        Ok(())
    }
}

fn points(table: &str, run: TrackedRunId, metrics: &[TrackedMetric]) -> QueryBuilder<Db> {
    let insert = format!("INSERT INTO {table} (run, key, step, time, value, is_nan) ");
    let mut query = QueryBuilder::<Db>::new(insert);
    query.push_values(metrics, |mut row, metric| {
        row.push_bind(run)
            .push_bind(metric.key.clone())
            .push_bind(metric.step)
            .push_bind(metric.time)
            .push_bind(metric.stored_value())
            .push_bind(metric.value.is_nan());
    });
    query
}

impl FromRow<'_, DbRow> for TrackedMetric {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        let is_nan: bool = row.try_get("is_nan")?;
        let value: f64 = row.try_get("value")?;
        Ok(Self {
            key: row.try_get("key")?,
            step: row.try_get("step")?,
            time: row.try_get("time")?,
            value: if is_nan { f64::NAN } else { value },
        })
    }
}
