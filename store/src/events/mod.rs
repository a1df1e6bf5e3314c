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

use crate::database::query::{FromRow, Row, sql};
use crate::database::{Horizon, Scope, Transaction};
use crate::{EventKind, JobId, Store, StoreError, Timestamp, boxed};

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
    /// When it happened.
    pub at: Timestamp,
    /// Which event it is.
    pub kind: EventKind,
    /// The job that it belongs to.
    pub job: JobId,
    /// The event's other fields. They depend on its kind.
    pub data: Value,
}

/// A choice of events.
#[derive(Clone, Copy, Debug, Default)]
pub struct EventFilter<'a> {
    /// Events of these jobs alone.
    pub jobs: Option<&'a [JobId]>,
    /// Events of this kind alone.
    pub kind: Option<EventKind>,
}

/// Reads each event that settles from now on, once.
#[derive(Debug)]
pub struct EventTail {
    store: Store,
    horizon: Horizon,
    position: i64,
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
        let mut tail = EventTail { store: self.clone(), horizon: Horizon::default(), position: 0 };
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
        let mut query = sql("SELECT id, at, kind, job, data FROM event WHERE id > ");
        query.push_bind(after).push(" AND id <= ").push_bind(up_to).push(" AND job IS NOT NULL");
        if let Some(kind) = filter.kind {
            query.push(" AND kind = ").push_bind(kind.as_str());
        }
        if let Some(jobs) = filter.jobs {
            query.push(" AND job IN ").push_ids(&jobs);
        }
        query.push(" ORDER BY id LIMIT ").push_bind(limit);
        query.all(&mut self.read("reading events")).await
    }

    /// The ids of the oldest and of the newest event that is kept; the event that marks the
    /// beginning counts.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn kept_events(&self) -> Result<(i64, i64), StoreError> {
        // Each is read from an end of the index.
        sql("SELECT (SELECT MIN(id) FROM event) AS oldest, (SELECT MAX(id) FROM event) AS newest")
            .one(&mut self.read("reading events"))
            .await
    }

    /// Deletes all events but the newest `keep`, and those that are older than `age`. The newest
    /// event always stays. Returns how many it deleted.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn forget_events(&self, keep: u32, age: Duration) -> Result<u64, StoreError> {
        let mut tx = self.begin(Scope::Rows, "forgetting old events").await?;
        let forgotten = tx.forget_events(keep.max(1), age).await?;
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
        self.store.database().settled_event(&mut self.horizon).await
    }
}

/// Writes an event that no trigger writes.
pub(crate) async fn tell(
    tx: &mut Transaction,
    kind: EventKind,
    job: JobId,
    data: &Value,
) -> Result<(), StoreError> {
    tx.tell(kind, job, data).await
}

impl Transaction {
    pub async fn tell(
        &mut self,
        kind: EventKind,
        job: JobId,
        data: &Value,
    ) -> Result<(), StoreError> {
        sql("INSERT INTO event (at, kind, job, data) VALUES ({now}, $1, $2, $3)")
            .bind(kind)
            .bind(job)
            .bind(data.to_string())
            .run(self)
            .await
    }

    /// Deletes all but the newest `keep` events and those older than `age`, but never the newest.
    /// Returns how many it deleted.
    pub async fn forget_events(&mut self, keep: u32, age: Duration) -> Result<u64, StoreError> {
        // Ids grow with time, so the first young event is found by reading from the beginning.
        let forgotten = sql("DELETE FROM event WHERE id <= (SELECT MAX(id) FROM event) - $1 \
                 OR id < COALESCE((SELECT id FROM event WHERE at >= {now} - $2 ORDER BY id \
                 LIMIT 1), (SELECT MAX(id) FROM event))")
        .bind(keep)
        .bind(age)
        .changed(self)
        .await?;
        Ok(forgotten)
    }
}

impl FromRow for Event {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        let kind = row.get("kind")?;
        Ok(Self {
            id: row.get("id")?,
            at: row.get("at")?,
            kind,
            job: row.get("job")?,
            data: row.get("data")?,
        })
    }
}
