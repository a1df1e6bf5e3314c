use sqlx::types::Json;
use sqlx::{FromRow, QueryBuilder, Row};

use super::rows::number;
use super::{Database, Db, DbRow, Transaction, integer};
use crate::{CurvePoint, RunId};

/// Rows per statement, with four values each. SQLite binds 32 766 values at most, PostgreSQL 65
/// 535.
const ROWS_PER_STATEMENT: usize = 4000;

/// Number of steps whose lowest and highest points are kept together. The migration that filled the
/// table uses the same number.
const SPAN: u64 = 64;

impl Database {
    pub async fn latest_metrics(
        &self,
        runs: &[RunId],
    ) -> Result<Vec<(RunId, String, CurvePoint)>, sqlx::Error> {
        let rows = sqlx::query(concat!(
            "SELECT run, key, step, time, value FROM metric_latest \
             WHERE run IN ",
            listed_ids!("$1"),
            " ORDER BY run, key"
        ))
        .bind(Json(runs))
        .fetch_all(&self.reader)
        .await?;
        rows.iter()
            .map(|row| Ok((row.try_get("run")?, row.try_get("key")?, CurvePoint::from_row(row)?)))
            .collect()
    }

    pub async fn latest_values(
        &self,
        runs: &[RunId],
        key: &str,
    ) -> Result<Vec<(RunId, CurvePoint)>, sqlx::Error> {
        let rows = sqlx::query(concat!(
            "SELECT run, step, time, value FROM metric_latest \
             WHERE run IN ",
            listed_ids!("$1"),
            " AND key = $2 ORDER BY run"
        ))
        .bind(Json(runs))
        .bind(key)
        .fetch_all(&self.reader)
        .await?;
        rows.iter().map(|row| Ok((row.try_get("run")?, CurvePoint::from_row(row)?))).collect()
    }

    /// Number of points of a metric, and number of spans that have points.
    pub async fn recorded_points(&self, run: RunId, key: &str) -> Result<(u64, u64), sqlx::Error> {
        let (points, spans): (i64, i64) = sqlx::query_as(
            "SELECT CAST(COALESCE(SUM(points), 0) AS BIGINT), COUNT(*) FROM metric_extremes \
             WHERE run = $1 AND key = $2",
        )
        .bind(run)
        .bind(key)
        .fetch_one(&self.reader)
        .await?;
        Ok((points.unsigned_abs(), spans.unsigned_abs()))
    }

    /// Sorted by step.
    pub async fn all_points(&self, run: RunId, key: &str) -> Result<Vec<CurvePoint>, sqlx::Error> {
        sqlx::query_as(
            "SELECT step, time, value FROM metric WHERE run = $1 AND key = $2 ORDER BY step",
        )
        .bind(run)
        .bind(key)
        .fetch_all(&self.reader)
        .await
    }

    /// Sorted by step: `limit` points after the first `skipped`.
    pub async fn points_after(
        &self,
        run: RunId,
        key: &str,
        skipped: u64,
        limit: u32,
    ) -> Result<Vec<CurvePoint>, sqlx::Error> {
        sqlx::query_as(
            "SELECT step, time, value FROM metric WHERE run = $1 AND key = $2 ORDER BY step \
             LIMIT $3 OFFSET $4",
        )
        .bind(run)
        .bind(key)
        .bind(i64::from(limit))
        .bind(integer(skipped))
        .fetch_all(&self.reader)
        .await
    }

    /// The lowest and the highest point of each of `ranges` ranges of spans, sorted by step.
    pub async fn extremes_of_spans(
        &self,
        run: RunId,
        key: &str,
        ranges: u32,
    ) -> Result<Vec<CurvePoint>, sqlx::Error> {
        sqlx::query_as(
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
        .bind(i64::from(ranges))
        .fetch_all(&self.reader)
        .await
    }

    /// The lowest and the highest point of each of `ranges` equal ranges of steps, sorted by step.
    pub async fn extreme_points(
        &self,
        run: RunId,
        key: &str,
        ranges: u32,
    ) -> Result<Vec<CurvePoint>, sqlx::Error> {
        sqlx::query_as(
            "WITH bound AS MATERIALIZED (SELECT MIN(step) AS low, MAX(step) AS high FROM metric \
                            WHERE run = $1 AND key = $2), \
             bucketed AS (SELECT step, time, value, \
                          (step - low) * $3 / (high - low + 1) AS bucket \
                          FROM metric, bound WHERE run = $1 AND key = $2), \
             ranked AS (SELECT step, time, value, \
                ROW_NUMBER() OVER (PARTITION BY bucket ORDER BY value NULLS FIRST, step) AS from_lowest, \
                ROW_NUMBER() OVER (PARTITION BY bucket ORDER BY value DESC NULLS LAST, step) AS from_highest \
                FROM bucketed) \
             SELECT step, time, value FROM ranked \
             WHERE from_lowest = 1 OR from_highest = 1 ORDER BY step",
        )
        .bind(run)
        .bind(key)
        .bind(i64::from(ranges))
        .fetch_all(&self.reader)
        .await
    }
}

impl Transaction {
    /// Inserts key, step and value of each metric, and replaces values at the same steps. No key
    /// may have a step twice.
    pub async fn insert_metrics(
        &mut self,
        run: RunId,
        metrics: &[(&str, u64, f64)],
    ) -> Result<(), sqlx::Error> {
        for part in metrics.chunks(ROWS_PER_STATEMENT) {
            let mut query =
                QueryBuilder::<Db>::new("INSERT INTO metric (run, key, step, time, value) ");
            query.push_values(part, |mut row, (key, step, value)| {
                row.push_bind(run)
                    .push_bind((*key).to_owned())
                    .push_bind(integer(*step))
                    .push(now!())
                    .push_bind(Some(*value).filter(|value| !value.is_nan()));
            });
            query.push(
                " ON CONFLICT (run, key, step) DO UPDATE SET time = excluded.time, \
                 value = excluded.value",
            );
            // Batches differ in length, so each statement is a different one. Keeping them would
            // only fill the cache.
            query.build().persistent(false).execute(self.connection()).await?;
        }
        Ok(())
    }

    /// Updates the latest value of a key.
    pub async fn set_latest(&mut self, run: RunId, key: &str) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "INSERT INTO metric_latest (run, key, step, time, value) \
             SELECT run, key, step, time, value FROM metric WHERE run = $1 AND key = $2 \
             ORDER BY step DESC LIMIT 1 \
             ON CONFLICT (run, key) DO UPDATE SET step = excluded.step, time = excluded.time, \
             value = excluded.value",
        )
        .bind(run)
        .bind(key);
        self.execute(statement).await
    }

    /// Updates the extremes of the spans from the step `first` to `last`. Spans without points stay
    /// as they are.
    pub async fn set_extremes(
        &mut self,
        run: RunId,
        key: &str,
        first: u64,
        last: u64,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
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
        .bind(integer(first - first % SPAN))
        .bind(integer(last - last % SPAN + (SPAN - 1)))
        .bind(integer(SPAN));
        self.execute(statement).await
    }

    /// Deletes the extremes of the span of `step` and of all later spans.
    pub async fn delete_extremes_from(
        &mut self,
        run: RunId,
        key: &str,
        step: u64,
    ) -> Result<(), sqlx::Error> {
        let statement =
            sqlx::query("DELETE FROM metric_extremes WHERE run = $1 AND key = $2 AND span >= $3")
                .bind(run)
                .bind(key)
                .bind(integer(step / SPAN));
        self.execute(statement).await
    }

    /// Returns the keys whose latest value was deleted.
    pub async fn delete_metrics_after(
        &mut self,
        run: RunId,
        step: u64,
    ) -> Result<Vec<String>, sqlx::Error> {
        sqlx::query("DELETE FROM metric WHERE run = $1 AND step > $2")
            .bind(run)
            .bind(integer(step))
            .execute(self.connection())
            .await?;
        sqlx::query_scalar("DELETE FROM metric_latest WHERE run = $1 AND step > $2 RETURNING key")
            .bind(run)
            .bind(integer(step))
            .fetch_all(self.connection())
            .await
    }
}

impl FromRow<'_, DbRow> for CurvePoint {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        // SQLite has no NaN. It is stored as NULL.
        let value: Option<f64> = row.try_get("value")?;
        Ok(Self {
            step: number(row, "step")?,
            time: row.try_get("time")?,
            value: value.unwrap_or(f64::NAN),
        })
    }
}
