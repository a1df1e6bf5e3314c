//! The connection that stays out of the pool between two operations.
//!
//! The pool of sqlx tests each connection that is returned to it, by a round trip. A worker that
//! claims and completes tasks would find its connection busy with this test, and would use another
//! connection in turn. So the last connection is kept, and the next operation begins with it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use sqlx::pool::PoolConnection;
use sqlx::{Connection, PgConnection, PgPool, Postgres};

use crate::Access;

/// A connection that was unused for this long is tested before it is used.
const TESTED_AFTER: Duration = Duration::from_millis(200);

/// At most one connection. It counts as one of the pool's, but an operation that waits for the pool
/// does not get it. So workers keep one, and servers do not.
#[derive(Clone, Debug)]
pub(super) struct KeptConnection {
    slot: Arc<Slot>,
    keeps: bool,
}

#[derive(Debug, Default)]
struct Slot(Mutex<Option<Unused>>);

#[derive(Debug)]
struct Unused {
    connection: PoolConnection<Postgres>,
    since: Instant,
}

impl Drop for Slot {
    /// Closes the connection. Returning it to the pool needs a runtime, which may have ended.
    fn drop(&mut self) {
        let kept = self.0.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        drop(kept.map(|unused| unused.connection.detach()));
    }
}

impl KeptConnection {
    pub fn of(access: Access) -> Self {
        Self { slot: Arc::default(), keeps: access == Access::Worker }
    }

    /// The kept connection, if it still works, or another one of the pool.
    pub async fn acquire(&self, pool: &PgPool) -> Result<PoolConnection<Postgres>, sqlx::Error> {
        let kept = self.unused().take();
        if let Some(Unused { mut connection, since }) = kept {
            if is_alive(&mut connection, since.elapsed()).await {
                return Ok(connection);
            }
            connection.close_on_drop();
        }
        pool.acquire().await
    }

    /// Keeps a connection on which nothing is under way. If one is kept, it goes back to the pool.
    pub fn keep(&self, connection: PoolConnection<Postgres>, pool: &PgPool) {
        let mut unused = self.unused();
        // A pool that is being closed waits for its connections.
        let surplus = if self.keeps && !pool.is_closed() {
            let kept = Unused { connection, since: Instant::now() };
            unused.replace(kept).map(|before| before.connection)
        } else {
            Some(connection)
        };
        drop(unused);
        drop(surplus);
    }

    /// Returns the connection to the pool.
    pub fn give_back(&self) {
        let kept = self.unused().take();
        drop(kept);
    }

    fn unused(&self) -> MutexGuard<'_, Option<Unused>> {
        self.slot.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whether a connection still works. One that was used a moment ago is not tested.
pub(super) async fn is_alive(connection: &mut PgConnection, idle_for: Duration) -> bool {
    idle_for < TESTED_AFTER || connection.ping().await.is_ok()
}
