//! Open shards, for reading single trajectories.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use store::{Shard, ShardContents, ShardReader, Store, StoreError, TableReader};
use tokio::sync::Semaphore;

use crate::error::ApiError;
use crate::limits::{OPEN_SHARDS, TRAJECTORY_READS};

/// Both tables of a shard.
#[derive(Clone)]
pub struct OpenShard {
    pub trajectories: ShardReader,
    pub robots: TableReader,
}

/// The most recently read shards. They are kept open, because opening one checks all its bytes.
#[derive(Clone)]
pub struct OpenShards {
    places: Arc<Semaphore>,
    slots: Arc<Mutex<VecDeque<Slot>>>,
}

/// A shard, identified by the path of its trajectories, which no other shard ever has.
#[derive(Clone)]
struct Slot {
    path: String,
    shard: Arc<Mutex<Option<OpenShard>>>,
}

impl OpenShards {
    pub fn new() -> Self {
        Self {
            places: Arc::new(Semaphore::new(TRAJECTORY_READS)),
            slots: Arc::new(Mutex::new(VecDeque::with_capacity(OPEN_SHARDS + 1))),
        }
    }

    /// The result of `read`, which runs on a thread where it may block.
    ///
    /// # Errors
    /// [`ApiError::ShardUnreadable`] when a file is missing or differs from what was published.
    pub async fn read<T: Send + 'static>(
        &self,
        store: &Store,
        shard: &Shard,
        read: impl FnOnce(&OpenShard) -> Result<T, StoreError> + Send + 'static,
    ) -> Result<T, ApiError> {
        let unreadable = |reason: String| ApiError::ShardUnreadable {
            dataset: shard.dataset.0,
            shard: shard.ordinal,
            reason,
        };
        let place = Arc::clone(&self.places).acquire_owned().await;
        let place = place.map_err(|_| ApiError::Internal)?;
        let slot = self.slot(&shard.contents.trajectories.path);
        let (store, contents) = (store.clone(), shard.contents.clone());
        let reading = tokio::task::spawn_blocking(move || {
            // The permit is held to the end, even if nobody waits any more.
            let _place = place;
            let open = slot.open(&store, &contents)?;
            read(&open)
        });
        // The decoder may panic on an invalid page.
        let read = reading.await.map_err(|panic| unreadable(panic.to_string()))?;
        read.map_err(|error| unreadable(spec::causes(&error)))
    }

    /// The slot of a shard, which is then the last to be closed.
    fn slot(&self, path: &str) -> Slot {
        let mut slots = lock(&self.slots);
        let known = slots.iter().position(|slot| slot.path == path);
        let slot = known
            .and_then(|at| slots.remove(at))
            .unwrap_or_else(|| Slot { path: path.to_owned(), shard: Arc::new(Mutex::new(None)) });
        slots.push_front(slot.clone());
        slots.truncate(OPEN_SHARDS);
        slot
    }
}

impl Slot {
    /// Opens the shard once. Other requests for it wait meanwhile.
    fn open(&self, store: &Store, shard: &ShardContents) -> Result<OpenShard, StoreError> {
        let mut open = lock(&self.shard);
        if let Some(open) = &*open {
            return Ok(open.clone());
        }
        let opened = OpenShard {
            trajectories: store.open_shard(shard)?,
            robots: store.open_table(&shard.robots)?,
        };
        Ok(open.insert(opened).clone())
    }
}

/// Ignores a poisoned lock: no change takes two steps, so the values are consistent after a panic.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
