//! Workers that Slurm or Kubernetes places, in the states that the engine shows.

use wire::PlacementState;

use crate::database::{Scope, sql};
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
    pub state: PlacementState,
    /// Why it waits, or how it ended.
    pub reason: Option<String>,
    /// The node that it runs on.
    pub node: Option<String>,
}

/// The record of a worker that was requested from an engine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placement {
    pub placed: Placed,
    pub asked_at: Timestamp,
    pub changed_at: Timestamp,
}

/// The engine that workers are requested from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Engine {
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
            Some(engine) => sql!(&mut tx, set_engine(engine))?,
            None => sql!(&mut tx, delete_engine())?,
        }
        tx.commit().await
    }

    /// # Errors
    /// When the database fails.
    pub async fn engine(&self) -> Result<Option<Engine>, StoreError> {
        sql!(self.database(), "reading the engine", engine())
    }

    /// Records workers in the states that their engine shows. Deletes workers that ended a day ago,
    /// and all but the newest 1000 that ended.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn record_placements(&self, placed: &[Placed]) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "recording placements").await?;
        sql!(&mut tx, forget_ended_placements(REMEMBER, REMEMBERED))?;
        for placed in placed {
            sql!(&mut tx, upsert_placement(placed))?;
        }
        tx.commit().await
    }

    /// The workers requested from an engine and those that ended within a day, sorted by name.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn placements(&self) -> Result<Vec<Placement>, StoreError> {
        sql!(self.database(), "reading placements", placements())
    }
}
