use std::time::Duration;

use serde_json::Value;
use sqlx::types::{Json, Text};
use sqlx::{FromRow, QueryBuilder, Row};

use super::rows::json;
use super::{Database, Db, DbRow, LISTED_IDS, Transaction, milliseconds};
use crate::{Event, EventFilter, EventKind, JobId};

impl Database {
    /// Events after `after` up to `up_to`, sorted by id.
    pub async fn events(
        &self,
        filter: &EventFilter<'_>,
        after: i64,
        up_to: i64,
        limit: u32,
    ) -> Result<Vec<Event>, sqlx::Error> {
        let mut query =
            QueryBuilder::<Db>::new("SELECT id, at, kind, job, data FROM event WHERE id > ");
        query.push_bind(after).push(" AND id <= ").push_bind(up_to).push(" AND job IS NOT NULL");
        if let Some(kind) = filter.kind {
            query.push(" AND kind = ").push_bind(kind.as_str());
        }
        if let Some(jobs) = filter.jobs {
            query.push(" AND job IN ").push(LISTED_IDS.0).push_bind(Json(jobs.to_vec()));
            query.push(LISTED_IDS.1);
        }
        query.push(" ORDER BY id LIMIT ").push_bind(i64::from(limit));
        query.build_query_as().fetch_all(&self.reader).await
    }

    /// The ids of the oldest and of the newest event that is kept.
    pub async fn kept_events(&self) -> Result<(i64, i64), sqlx::Error> {
        // Each is read from an end of the index.
        sqlx::query_as(
            "SELECT (SELECT MIN(id) FROM event) AS oldest, (SELECT MAX(id) FROM event) AS newest",
        )
        .fetch_one(&self.reader)
        .await
    }
}

impl Transaction {
    pub async fn tell(
        &mut self,
        kind: EventKind,
        job: JobId,
        data: &Value,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "INSERT INTO event (at, kind, job, data) VALUES (",
            now!(),
            ", $1, $2, $3)"
        ))
        .bind(kind.as_str())
        .bind(job)
        .bind(data.to_string());
        self.execute(statement).await
    }

    /// Deletes all but the newest `keep` events and those older than `age`, but never the newest.
    /// Returns how many it deleted.
    pub async fn forget_events(&mut self, keep: u32, age: Duration) -> Result<u64, sqlx::Error> {
        // Ids grow with time, so the first young event is found by reading from the beginning.
        let forgotten = sqlx::query(concat!(
            "DELETE FROM event WHERE id <= (SELECT MAX(id) FROM event) - $1 \
             OR id < COALESCE((SELECT id FROM event WHERE at >= ",
            now!(),
            " - $2 ORDER BY id LIMIT 1), (SELECT MAX(id) FROM event))"
        ))
        .bind(i64::from(keep))
        .bind(milliseconds(age))
        .execute(self.connection())
        .await?;
        Ok(forgotten.rows_affected())
    }
}

impl FromRow<'_, DbRow> for Event {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        let Text(kind) = row.try_get("kind")?;
        Ok(Self {
            id: row.try_get("id")?,
            at: row.try_get("at")?,
            kind,
            job: row.try_get("job")?,
            data: json(row, "data")?,
        })
    }
}
