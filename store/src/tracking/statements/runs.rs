use std::time::Duration;

use sqlx::types::{Json, Text};
use sqlx::{FromRow, QueryBuilder, Row};

use super::rows::state;
use super::{Database, Db, DbRow, LISTED_IDS, LISTED_TEXTS, Transaction, milliseconds};
use crate::{ExperimentId, NewTrackedRun, TrackedRun, TrackedRunId};

macro_rules! select_tracked_run {
    ($($rest:expr),+ $(,)?) => {
        concat!("SELECT tracked_run.*, status AS state FROM tracked_run ", $($rest),+)
    };
}

/// Rows per statement, with three values each. SQLite binds 32 766 values at most.
const ROWS_PER_STATEMENT: usize = 4000;

impl Database {
    pub async fn tracked_run(&self, identifier: &str) -> Result<Option<TrackedRun>, sqlx::Error> {
        sqlx::query_as(select_tracked_run!("WHERE identifier = $1"))
            .bind(identifier)
            .fetch_optional(&self.reader)
            .await
    }

    pub async fn tracked_runs(
        &self,
        experiments: &[ExperimentId],
    ) -> Result<Vec<TrackedRun>, sqlx::Error> {
        sqlx::query_as(select_tracked_run!(
            "WHERE experiment IN ",
            listed_ids!("$1"),
            " ORDER BY id DESC"
        ))
        .bind(Json(experiments))
        .fetch_all(&self.reader)
        .await
    }

    /// Reads a table of texts with keys.
    pub async fn tracked_texts(
        &self,
        table: &str,
        runs: &[TrackedRunId],
        keys: Option<&[String]>,
    ) -> Result<Vec<(TrackedRunId, String, String)>, sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(format!("SELECT run, key, value FROM {table}"));
        query.push(" WHERE run IN ").push(LISTED_IDS.0).push_bind(Json(runs.to_vec()));
        query.push(LISTED_IDS.1);
        if let Some(keys) = keys {
            query.push(" AND key IN ").push(LISTED_TEXTS.0).push_bind(Json(keys.to_vec()));
            query.push(LISTED_TEXTS.1);
        }
        query.push(" ORDER BY run, key");
        query.build_query_as().fetch_all(&self.reader).await
    }
}

impl Transaction {
    /// A run, locked so that nobody else writes to it until the transaction ends.
    pub async fn kept_run(&mut self, identifier: &str) -> Result<Option<TrackedRun>, sqlx::Error> {
        sqlx::query_as(select_tracked_run!("WHERE identifier = $1", locked!()))
            .bind(identifier)
            .fetch_optional(self.connection())
            .await
    }

    pub async fn insert_tracked_run(
        &mut self,
        new: &NewTrackedRun,
    ) -> Result<TrackedRun, sqlx::Error> {
        // The identifier is drawn once and used in both places.
        sqlx::query_as(concat!(
            "WITH drawn (identifier) AS MATERIALIZED (SELECT ",
            unique_digits!(),
            ") INSERT INTO tracked_run \
                (identifier, experiment, name, user_name, status, start_time, created_at) \
             SELECT drawn.identifier, $1, COALESCE($2, 'run-' || substr(drawn.identifier, 1, 8)), \
                $3, 'RUNNING', $4, ",
            now!(),
            " FROM drawn RETURNING *, status AS state"
        ))
        .bind(new.experiment)
        .bind(new.name.as_deref())
        .bind(&new.user)
        .bind(new.start_time)
        .fetch_one(self.connection())
        .await
    }

    pub async fn update_tracked_run(&mut self, run: &TrackedRun) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "UPDATE tracked_run SET name = $2, status = $3, end_time = $4 WHERE id = $1",
        )
        .bind(run.id)
        .bind(&run.name)
        .bind(Text(run.status))
        .bind(run.end_time);
        self.execute(statement).await
    }

    /// Moves a run into the trash for `keep`, or out of it. A run that is in the trash already
    /// keeps its date.
    pub async fn set_tracked_run_deleted(
        &mut self,
        run: TrackedRunId,
        keep: Option<Duration>,
    ) -> Result<(), sqlx::Error> {
        let statement = match keep {
            Some(keep) => sqlx::query(concat!(
                "UPDATE tracked_run SET is_deleted = TRUE, deleted_at = ",
                now!(),
                ", purge_at = ",
                now!(),
                " + $2 WHERE id = $1 AND NOT is_deleted"
            ))
            .bind(run)
            .bind(milliseconds(keep)),
            None => sqlx::query(
                "UPDATE tracked_run SET is_deleted = FALSE, deleted_at = NULL, purge_at = NULL \
                 WHERE id = $1",
            )
            .bind(run),
        };
        self.execute(statement).await
    }

    /// Sets tags. No key may appear twice.
    pub async fn set_tracked_tags(
        &mut self,
        run: TrackedRunId,
        tags: &[(String, String)],
    ) -> Result<(), sqlx::Error> {
        for part in tags.chunks(ROWS_PER_STATEMENT) {
            let mut query = texts("tracked_tag", run, part);
            query.push(" ON CONFLICT (run, key) DO UPDATE SET value = excluded.value");
            query.build().persistent(false).execute(self.connection()).await?;
        }
        Ok(())
    }

    /// Adds params and leaves existing ones as they are. No key may appear twice.
    pub async fn add_tracked_params(
        &mut self,
        run: TrackedRunId,
        params: &[(String, String)],
    ) -> Result<(), sqlx::Error> {
        for part in params.chunks(ROWS_PER_STATEMENT) {
            let mut query = texts("tracked_param", run, part);
            query.push(" ON CONFLICT (run, key) DO NOTHING");
            query.build().persistent(false).execute(self.connection()).await?;
        }
        Ok(())
    }

    pub async fn params_of(
        &mut self,
        run: TrackedRunId,
        keys: &[&str],
    ) -> Result<Vec<(String, String)>, sqlx::Error> {
        sqlx::query_as(concat!(
            "SELECT key, value FROM tracked_param WHERE run = $1 AND key IN ",
            listed_texts!("$2")
        ))
        .bind(run)
        .bind(Json(keys))
        .fetch_all(self.connection())
        .await
    }

    /// Returns whether the tag existed.
    pub async fn delete_tracked_tag(
        &mut self,
        run: TrackedRunId,
        key: &str,
    ) -> Result<bool, sqlx::Error> {
        let deleted = sqlx::query("DELETE FROM tracked_tag WHERE run = $1 AND key = $2")
            .bind(run)
            .bind(key)
            .execute(self.connection())
            .await?;
        Ok(deleted.rows_affected() > 0)
    }
}

fn texts(table: &str, run: TrackedRunId, rows: &[(String, String)]) -> QueryBuilder<Db> {
    let mut query = QueryBuilder::<Db>::new(format!("INSERT INTO {table} (run, key, value) "));
    query.push_values(rows, |mut row, (key, value)| {
        row.push_bind(run).push_bind(key.clone()).push_bind(value.clone());
    });
    query
}

impl FromRow<'_, DbRow> for TrackedRun {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            identifier: row.try_get("identifier")?,
            experiment: row.try_get("experiment")?,
            name: row.try_get("name")?,
            user: row.try_get("user_name")?,
            status: state(row)?,
            start_time: row.try_get("start_time")?,
            end_time: row.try_get("end_time")?,
            is_deleted: row.try_get("is_deleted")?,
        })
    }
}
