//! Metrics: numbers of a run over its steps.

use sqlx::sqlite::SqliteRow;
use sqlx::{FromRow, QueryBuilder, Row, Sqlite, SqliteConnection};

use crate::clock::now;
use crate::database::integer;
use crate::{Fence, RunId, Store, StoreError, Timestamp, leases};

/// A number to record.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// E.g. `train/loss`.
    pub key: String,
    pub step: u64,
    /// May be NaN, as the loss of a training that diverged.
    pub value: f64,
}

/// A metric over steps, thinned out for drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    pub key: String,
    /// By step.
    pub points: Vec<SeriesPoint>,
    /// Points recorded.
    pub recorded: u64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeriesPoint {
    pub step: u64,
    pub time: Timestamp,
    pub value: f64,
}

/// Rows per statement: SQLite binds at most 32 766 values.
const ROWS_PER_STATEMENT: usize = 4000;

impl Store {
    /// Records metrics of the run of the fence's job. A step that was recorded before is replaced,
    /// since a resumed training takes it again.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn record_metrics(&self, fence: Fence, metrics: &[Metric]) -> Result<(), StoreError> {
        const OPERATION: &str = "recording metrics";
        let failed = StoreError::database(OPERATION);
        let mut tx = self.database().write(OPERATION).await?;
        let run = leases::check_run(&mut tx, fence).await?;
        for part in metrics.chunks(ROWS_PER_STATEMENT) {
            insert(&mut tx, run, part).await.map_err(&failed)?;
        }
        let mut keys: Vec<&str> = metrics.iter().map(|metric| metric.key.as_str()).collect();
        keys.sort_unstable();
        keys.dedup();
        for key in keys {
            set_latest(&mut tx, run, key).await.map_err(&failed)?;
        }
        tx.commit().await.map_err(&failed)
    }

    /// Forgets what was recorded after `step`, as a training does that resumes from there.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn delete_metrics_after(&self, fence: Fence, step: u64) -> Result<(), StoreError> {
        const OPERATION: &str = "deleting metrics";
        let failed = StoreError::database(OPERATION);
        let mut tx = self.database().write(OPERATION).await?;
        let run = leases::check_run(&mut tx, fence).await?;
        sqlx::query("DELETE FROM metric WHERE run = ? AND step > ?")
            .bind(run)
            .bind(integer(step))
            .execute(&mut *tx)
            .await
            .map_err(&failed)?;
        let stale: Vec<String> = sqlx::query_scalar(
            "DELETE FROM metric_latest WHERE run = ? AND step > ? RETURNING key",
        )
        .bind(run)
        .bind(integer(step))
        .fetch_all(&mut *tx)
        .await
        .map_err(&failed)?;
        for key in stale {
            set_latest(&mut tx, run, &key).await.map_err(&failed)?;
        }
        tx.commit().await.map_err(&failed)
    }

    /// The value at the last step of every key of each run, by run and key.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn latest_metrics(
        &self,
        runs: &[RunId],
    ) -> Result<Vec<(RunId, String, SeriesPoint)>, StoreError> {
        let mut query = QueryBuilder::<Sqlite>::new(
            "SELECT run, key, step, time, value FROM metric_latest WHERE run IN (",
        );
        let mut list = query.separated(", ");
        for run in runs {
            list.push_bind(*run);
        }
        query.push(") ORDER BY run, key");
        let failed = StoreError::database("reading the latest metrics");
        let rows = query.build().fetch_all(self.database().reader()).await.map_err(&failed)?;
        rows.iter()
            .map(|row| Ok((row.try_get("run")?, row.try_get("key")?, SeriesPoint::from_row(row)?)))
            .collect::<Result<_, sqlx::Error>>()
            .map_err(&failed)
    }

    /// A metric in at most `points` points: all of them, or the lowest and the highest of each of
    /// `points / 2` equal ranges of steps, so that no spike is lost.
    ///
    /// # Errors
    /// When the database fails; a key that was never recorded has no points.
    pub async fn series(&self, run: RunId, key: &str, points: u32) -> Result<Series, StoreError> {
        let failed = StoreError::database("reading a metric");
        let recorded: i64 =
            sqlx::query_scalar("SELECT COUNT(*) FROM metric WHERE run = ? AND key = ?")
                .bind(run)
                .bind(key)
                .fetch_one(self.database().reader())
                .await
                .map_err(&failed)?;
        let query = if recorded <= i64::from(points) {
            sqlx::query_as(
                "SELECT step, time, value FROM metric WHERE run = ?1 AND key = ?2 ORDER BY step",
            )
        } else {
            sqlx::query_as(
                "WITH bound AS (SELECT MIN(step) AS low, MAX(step) AS high FROM metric \
                                WHERE run = ?1 AND key = ?2), \
                 bucketed AS (SELECT step, time, value, \
                              (step - low) * ?3 / (high - low + 1) AS bucket \
                              FROM metric, bound WHERE run = ?1 AND key = ?2), \
                 ranked AS (SELECT step, time, value, \
                    ROW_NUMBER() OVER (PARTITION BY bucket ORDER BY value, step) AS from_lowest, \
                    ROW_NUMBER() OVER (PARTITION BY bucket ORDER BY value DESC, step) AS from_highest \
                    FROM bucketed) \
                 SELECT step, time, value FROM ranked \
                 WHERE from_lowest = 1 OR from_highest = 1 ORDER BY step",
            )
        };
        let points = query
            .bind(run)
            .bind(key)
            .bind((points / 2).max(1))
            .fetch_all(self.database().reader())
            .await
            .map_err(&failed)?;
        Ok(Series { key: key.to_owned(), points, recorded: recorded.unsigned_abs() })
    }
}

async fn insert(
    conn: &mut SqliteConnection,
    run: RunId,
    metrics: &[Metric],
) -> Result<(), sqlx::Error> {
    let mut query =
        QueryBuilder::<Sqlite>::new("INSERT INTO metric (run, key, step, time, value) ");
    query.push_values(metrics, |mut row, metric| {
        row.push_bind(run)
            .push_bind(metric.key.clone())
            .push_bind(integer(metric.step))
            .push(now!())
            .push_bind(metric.value);
    });
    query.push(
        " ON CONFLICT (run, key, step) DO UPDATE SET time = excluded.time, value = excluded.value",
    );
    // Batches differ in length, so each statement is another one: keeping them would only fill
    // the cache.
    query.build().persistent(false).execute(conn).await?;
    Ok(())
}

async fn set_latest(conn: &mut SqliteConnection, run: RunId, key: &str) -> Result<(), sqlx::Error> {
    sqlx::query(
        "INSERT INTO metric_latest (run, key, step, time, value) \
         SELECT run, key, step, time, value FROM metric WHERE run = ? AND key = ? \
         ORDER BY step DESC LIMIT 1 \
         ON CONFLICT (run, key) DO UPDATE SET step = excluded.step, time = excluded.time, \
         value = excluded.value",
    )
    .bind(run)
    .bind(key)
    .execute(conn)
    .await?;
    Ok(())
}

impl FromRow<'_, SqliteRow> for SeriesPoint {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        // SQLite has no NaN and keeps NULL in its place.
        let value: Option<f64> = row.try_get("value")?;
        Ok(Self {
            step: row.try_get("step")?,
            time: row.try_get("time")?,
            value: value.unwrap_or(f64::NAN),
        })
    }
}
