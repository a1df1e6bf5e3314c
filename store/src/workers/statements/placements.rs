use std::time::Duration;

use sqlx::{FromRow, Row};

use super::{Database, DbRow, Transaction, milliseconds, rows};
use crate::{Engine, Placed, Placement};

impl Database {
    pub async fn engine(&self) -> Result<Option<Engine>, sqlx::Error> {
        let row: Option<(String, Option<String>)> =
            sqlx::query_as("SELECT name, obstacle FROM engine")
                .fetch_optional(&self.reader)
                .await?;
        Ok(row.map(|(name, obstacle)| Engine { name, obstacle }))
    }

    /// Sorted by name.
    pub async fn placements(&self) -> Result<Vec<Placement>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM placement ORDER BY worker").fetch_all(&self.reader).await
    }
}

impl Transaction {
    pub async fn set_engine(&mut self, engine: &Engine) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "INSERT INTO engine (id, name, obstacle) VALUES (1, $1, $2) ON CONFLICT (id) DO UPDATE \
             SET name = excluded.name, obstacle = excluded.obstacle",
        )
        .bind(&engine.name)
        .bind(&engine.obstacle);
        self.execute(statement).await
    }

    pub async fn delete_engine(&mut self) -> Result<(), sqlx::Error> {
        self.execute(sqlx::query("DELETE FROM engine")).await
    }

    /// Inserts or updates a worker. A worker that has ended does not change any more.
    pub async fn upsert_placement(&mut self, placed: &Placed) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "INSERT INTO placement (worker, engine, identifier, state, reason, node, asked_at, \
              changed_at) VALUES ($1, $2, $3, $4, $5, $6, ",
            now!(),
            ", ",
            now!(),
            ") ON CONFLICT (worker) DO UPDATE SET identifier = excluded.identifier, \
              state = excluded.state, reason = excluded.reason, \
              node = COALESCE(excluded.node, placement.node), changed_at = excluded.changed_at \
              WHERE placement.state <> 'ended'"
        ))
        .bind(&placed.worker)
        .bind(&placed.engine)
        .bind(&placed.identifier)
        .bind(placed.state.as_str())
        .bind(&placed.reason)
        .bind(&placed.node);
        self.execute(statement).await
    }

    /// Deletes workers that ended long ago, and all ended workers except the newest `keep`.
    pub async fn forget_ended_placements(
        &mut self,
        after: Duration,
        keep: u32,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "DELETE FROM placement WHERE state = 'ended' AND (changed_at < ",
            now!(),
            " - $1 OR worker NOT IN (SELECT worker FROM placement WHERE state = 'ended' \
              ORDER BY changed_at DESC, worker LIMIT $2))"
        ))
        .bind(milliseconds(after))
        .bind(i64::from(keep));
        self.execute(statement).await
    }
}

impl FromRow<'_, DbRow> for Placement {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            placed: Placed {
                worker: row.try_get("worker")?,
                engine: row.try_get("engine")?,
                identifier: row.try_get("identifier")?,
                state: rows::state(row)?,
                reason: row.try_get("reason")?,
                node: row.try_get("node")?,
            },
            asked_at: row.try_get("asked_at")?,
            changed_at: row.try_get("changed_at")?,
        })
    }
}
