//! Events of jobs, in order, for clients that follow them.
//!
//! Triggers of the database write the events of jobs and tasks, so every change of a state has its
//! event. [`tell`] writes the others. An event is written in the same transaction as the change.
//! Heartbeats write no events.
//!
//! Nobody is notified of an event: one tail in each server looks for them, five times a second,
//! while somebody listens. In PostgreSQL a row may come after one with a larger id. So a tail reads
//! ids up to a mark once all transactions that were open at the mark have ended. Events stay with
//! their database when a store moves.

use std::time::Duration;

use serde_json::Value;

use crate::boxed;
use crate::database::postgres;
use crate::database::sqlite;
use crate::database::{Database, Scope, Transaction, sql};
use crate::{EventKind, JobId, Store, StoreError, Timestamp};

/// Number of events kept, about 40 MB. Older ones are deleted.
pub const EVENTS_KEPT: u32 = 100_000;

/// How long an event is kept.
pub const EVENTS_KEPT_FOR: Duration = Duration::from_secs(7 * 24 * 60 * 60);

/// Number of events that a tail reads at once.
const PAGE: u32 = 500;

/// Something that happened to a job.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// The ids follow the order in which events have settled. No event appears later with a smaller
    /// id than one that was read from an [`EventTail`].
    pub id: i64,
    pub at: Timestamp,
    pub kind: EventKind,
    pub job: JobId,
    /// The event's other fields. They depend on its kind.
    pub data: Value,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct EventFilter<'a> {
    pub jobs: Option<&'a [JobId]>,
    pub kind: Option<EventKind>,
}

/// Reads each event that settles from now on, once.
#[derive(Debug)]
pub struct EventTail {
    store: Store,
    horizon: Horizon,
    position: i64,
}

#[derive(Debug)]
enum Horizon {
    Sqlite(sqlite::Horizon),
    Postgres(postgres::Horizon),
}

impl Store {
    /// A tail that begins after the newest settled event. `None` while transactions are open that
    /// may have written earlier events.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn event_tail(&self) -> Result<Option<EventTail>, StoreError> {
        /// Pause before looking again whether those transactions have ended.
        const LOOK_EVERY: Duration = Duration::from_millis(20);
        const LOOKS: u32 = 100;
        let horizon = match self.database() {
            Database::Sqlite(_) => Horizon::Sqlite(sqlite::Horizon),
            Database::Postgres(_) => Horizon::Postgres(postgres::Horizon::default()),
        };
        let mut tail = EventTail { store: self.clone(), horizon, position: 0 };
        for _ in 0..LOOKS {
            if let Some(settled) = tail.settled().await? {
                tail.position = settled;
                return Ok(Some(tail));
            }
            tokio::time::sleep(LOOK_EVERY).await;
        }
        Ok(None)
    }

    /// Events sorted by id: those after `after` up to `up_to`, `limit` at most. All settled events
    /// of that range are among them.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn events(
        &self,
        filter: &EventFilter<'_>,
        after: i64,
        up_to: i64,
        limit: u32,
    ) -> Result<Vec<Event>, StoreError> {
        sql!(self.database(), "reading events", events(filter, after, up_to, limit))
    }

    /// The ids of the oldest and of the newest event that is kept; the event that marks the
    /// beginning counts.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn kept_events(&self) -> Result<(i64, i64), StoreError> {
        sql!(self.database(), "reading events", kept_events())
    }

    /// Deletes all events but the newest `keep`, and those that are older than `age`. The newest
    /// event always stays. Returns how many it deleted.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn forget_events(&self, keep: u32, age: Duration) -> Result<u64, StoreError> {
        let mut tx = self.begin(Scope::Rows, "forgetting old events").await?;
        let forgotten = sql!(&mut tx, forget_events(keep.max(1), age))?;
        tx.commit().await?;
        Ok(forgotten)
    }
}

impl EventTail {
    /// Events up to this id were read, or were written before the tail began.
    pub const fn position(&self) -> i64 {
        self.position
    }

    /// The events that have settled since the last call, sorted by id. If there are many, only the
    /// first of them.
    ///
    /// # Errors
    /// When the database fails. Call it again then.
    #[boxed]
    pub async fn read(&mut self) -> Result<Vec<Event>, StoreError> {
        let Some(settled) = self.settled().await? else { return Ok(Vec::new()) };
        if settled <= self.position {
            return Ok(Vec::new());
        }
        let after = self.position;
        let events = self.store.events(&EventFilter::default(), after, settled, PAGE).await?;
        let is_all = u32::try_from(events.len()).is_ok_and(|read| read < PAGE);
        self.position = match events.last() {
            Some(last) if !is_all => last.id,
            _ => settled,
        };
        Ok(events)
    }

    async fn settled(&mut self) -> Result<Option<i64>, StoreError> {
        let settled = match (&mut self.horizon, self.store.database()) {
            (Horizon::Sqlite(horizon), Database::Sqlite(database)) => {
                database.settled_event(horizon).await
            }
            (Horizon::Postgres(horizon), Database::Postgres(database)) => {
                database.settled_event(horizon).await
            }
            // A store does not change its database.
            _ => Ok(None),
        };
        settled.map_err(StoreError::database("looking for events"))
    }
}

/// Writes an event that no trigger writes.
pub(crate) async fn tell(
    tx: &mut Transaction,
    kind: EventKind,
    job: JobId,
    data: &Value,
) -> Result<(), StoreError> {
    sql!(tx, tell(kind, job, data))
}
