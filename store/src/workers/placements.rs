//! Workers that Slurm or Kubernetes places, in the states that the engine shows.

use std::time::Duration;

use wire::PlacementState;

use crate::database::query::{from_row, sql};
use crate::database::{Scope, Transaction};
use crate::workers::REMEMBER;
use crate::{Store, StoreError, Timestamp};

/// A worker as its engine shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placed {
    /// The worker's name.
    pub worker: String,
    /// `slurm` or `kubernetes`.
    pub engine: String,
    /// The engine's name for it, once it has one.
    pub identifier: Option<String>,
    /// Where the engine says that it stands.
    pub state: PlacementState,
    /// Why it waits, or how it ended.
    pub reason: Option<String>,
    /// The node that it runs on.
    pub node: Option<String>,
}

/// The record of a worker that was requested from an engine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placement {
    /// The worker, as the engine last described it.
    pub placed: Placed,
    /// When the engine was asked for it.
    pub asked_at: Timestamp,
    /// When the engine last described it.
    pub changed_at: Timestamp,
}

/// The engine that workers are requested from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Engine {
    /// The name of the engine, such as `Slurm`.
    pub name: String,
    /// Why it provides no workers at the moment.
    pub obstacle: Option<String>,
}

/// Number of ended workers that are remembered.
const REMEMBERED: u32 = 1000;

impl Store {
    /// Sets the engine that workers are requested from; `None` where a server starts its own.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn set_engine(&self, engine: Option<&Engine>) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "setting the engine").await?;
        match engine {
            Some(engine) => tx.set_engine(engine).await?,
            None => tx.delete_engine().await?,
        }
        tx.commit().await
    }

    /// # Errors
    /// When the database fails.
    pub async fn engine(&self) -> Result<Option<Engine>, StoreError> {
        let row: Option<(String, Option<String>)> = sql("SELECT name, obstacle FROM engine")
            .optional(&mut self.read("reading the engine"))
            .await?;
        Ok(row.map(|(name, obstacle)| Engine { name, obstacle }))
    }

    /// Records workers in the states that their engine shows. Deletes workers that ended a day ago,
    /// and all but the newest 1000 that ended.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn record_placements(&self, placed: &[Placed]) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "recording placements").await?;
        tx.forget_ended_placements(REMEMBER, REMEMBERED).await?;
        for placed in placed {
            tx.upsert_placement(placed).await?;
        }
        tx.commit().await
    }

    /// The workers requested from an engine and those that ended within a day, sorted by name.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn placements(&self) -> Result<Vec<Placement>, StoreError> {
        sql("SELECT * FROM placement ORDER BY worker")
            .all(&mut self.read("reading placements"))
            .await
    }
}

impl Transaction {
    pub async fn set_engine(&mut self, engine: &Engine) -> Result<(), StoreError> {
        sql(
            "INSERT INTO engine (id, name, obstacle) VALUES (1, $1, $2) ON CONFLICT (id) DO UPDATE \
             SET name = excluded.name, obstacle = excluded.obstacle",
        )
        .bind(&engine.name)
        .bind(&engine.obstacle)
        .run(self)
        .await
    }

    pub async fn delete_engine(&mut self) -> Result<(), StoreError> {
        sql("DELETE FROM engine").run(self).await
    }

    /// Inserts or updates a worker. A worker that has ended does not change any more.
    pub async fn upsert_placement(&mut self, placed: &Placed) -> Result<(), StoreError> {
        sql("INSERT INTO placement (worker, engine, identifier, state, reason, node, asked_at, \
             changed_at) VALUES ($1, $2, $3, $4, $5, $6, {now}, {now}) \
             ON CONFLICT (worker) DO UPDATE SET identifier = excluded.identifier, state = \
             excluded.state, reason = excluded.reason, node = COALESCE(excluded.node, \
             placement.node), changed_at = excluded.changed_at WHERE placement.state <> 'ended'")
        .bind(&placed.worker)
        .bind(&placed.engine)
        .bind(&placed.identifier)
        .bind(placed.state)
        .bind(&placed.reason)
        .bind(&placed.node)
        .run(self)
        .await
    }

    /// Deletes workers that ended long ago, and all ended workers except the newest `keep`.
    pub async fn forget_ended_placements(
        &mut self,
        after: Duration,
        keep: u32,
    ) -> Result<(), StoreError> {
        sql("DELETE FROM placement WHERE state = 'ended' AND (changed_at < {now} - $1 \
             OR worker NOT IN (SELECT worker FROM placement WHERE state = 'ended' \
             ORDER BY changed_at DESC, worker LIMIT $2))")
        .bind(after)
        .bind(keep)
        .run(self)
        .await
    }
}

from_row!(Placement {
    asked_at, changed_at,
    ..row =>
    placed: Placed {
        worker: row.get("worker")?,
        engine: row.get("engine")?,
        identifier: row.get("identifier")?,
        state: row.get("state")?,
        reason: row.get("reason")?,
        node: row.get("node")?,
    },
});
