//! Idle connections: they have no running request, and wait for the next one. If there is no room
//! for a new connection, the connection that has been idle for longest is closed.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio_util::sync::CancellationToken;

/// The idle connections, ordered by the time at which they became idle.
#[derive(Clone, Default)]
pub struct IdleConnections(Arc<Mutex<IdleQueue>>);

#[derive(Default)]
struct IdleQueue {
    next: u64,
    idle: BTreeMap<u64, CancellationToken>,
    /// Whether a new connection waits for a place. If so, the next connection that becomes idle is
    /// closed.
    next_is_closed: bool,
}

/// A connection of a client. It is idle until a request comes.
pub struct ClientConnection {
    all: IdleConnections,
    close: CancellationToken,
    state: Mutex<ConnectionState>,
    has_had_request: AtomicBool,
}

enum ConnectionState {
    Idle(u64),
    Busy,
    Ended,
}

/// Marks a request as running until its answer has been sent.
pub struct RunningRequest(Arc<ClientConnection>);

impl IdleConnections {
    /// Registers a connection that has got a place.
    pub fn register(&self) -> Arc<ClientConnection> {
        let close = CancellationToken::new();
        let mut line = lock(&self.0);
        line.next_is_closed = false;
        let state = Mutex::new(ConnectionState::Idle(line.enter(&close)));
        drop(line);
        Arc::new(ClientConnection {
            all: self.clone(),
            close,
            state,
            has_had_request: AtomicBool::new(false),
        })
    }

    /// Closes the connection that has been idle for longest. If none is idle, closes the next one
    /// that becomes idle, unless a place becomes free before.
    pub fn close_one(&self) {
        let mut line = lock(&self.0);
        match line.idle.pop_first() {
            Some((_, close)) => close.cancel(),
            None => line.next_is_closed = true,
        }
    }

    fn leave(&self, number: u64) {
        lock(&self.0).idle.remove(&number);
    }
}

impl IdleQueue {
    fn enter(&mut self, close: &CancellationToken) -> u64 {
        let number = self.next;
        self.next += 1;
        if std::mem::take(&mut self.next_is_closed) {
            close.cancel();
        } else {
            self.idle.insert(number, close.clone());
        }
        number
    }
}

impl ClientConnection {
    /// Completes when the connection has to be closed for another one.
    pub async fn close_requested(&self) {
        self.close.cancelled().await;
    }

    /// Marks the connection as having a request, until the returned value is dropped.
    pub fn begin_request(self: &Arc<Self>) -> RunningRequest {
        self.has_had_request.store(true, Ordering::Relaxed);
        self.change(ConnectionState::Busy);
        if self.close.is_cancelled() {
            // The place was promised to another connection, which now needs a different one.
            self.all.close_one();
        }
        RunningRequest(Arc::clone(self))
    }

    /// Whether a request was ever received. A part of its answer may still be on its way.
    pub fn has_had_request(&self) -> bool {
        self.has_had_request.load(Ordering::Relaxed)
    }

    /// Whether a request is running.
    pub fn has_running_request(&self) -> bool {
        matches!(*lock(&self.state), ConnectionState::Busy)
    }

    /// Removes the connection: it is closed, or has switched from HTTP to another protocol.
    pub fn end(&self) {
        self.change(ConnectionState::Ended);
    }

    fn change(&self, to: ConnectionState) {
        let mut state = lock(&self.state);
        if let ConnectionState::Idle(number) = *state {
            self.all.leave(number);
        }
        *state = to;
    }
}

impl Drop for RunningRequest {
    fn drop(&mut self) {
        let ClientConnection { all, close, state, .. } = &*self.0;
        let mut state = lock(state);
        if matches!(*state, ConnectionState::Busy) {
            *state = ConnectionState::Idle(lock(&all.0).enter(close));
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // No code panics while it holds the lock.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_idle_connection_is_closed_and_none_with_a_request() {
        let all = IdleConnections::default();
        let (first, second, third) = (all.register(), all.register(), all.register());
        let running = first.begin_request();
        third.end();
        all.close_one();
        assert!(second.close.is_cancelled() && !first.close.is_cancelled());
        // None is idle until the first has its answer.
        all.close_one();
        assert!(!first.close.is_cancelled() && !third.close.is_cancelled());
        drop(running);
        assert!(first.close.is_cancelled());
        // One place was wanted, not every place.
        assert!(!all.register().close.is_cancelled());
    }

    #[test]
    fn a_connection_whose_request_comes_as_it_is_closed_passes_that_to_the_next() {
        let all = IdleConnections::default();
        let (first, second) = (all.register(), all.register());
        all.close_one();
        assert!(first.close.is_cancelled() && !second.close.is_cancelled());
        let _request = first.begin_request();
        assert!(second.close.is_cancelled());
    }

    #[test]
    fn a_connection_that_got_a_free_place_keeps_it() {
        let all = IdleConnections::default();
        let only = all.register();
        let running = only.begin_request();
        all.close_one();
        only.end();
        drop(running);
        assert!(!all.register().close.is_cancelled());
    }

    #[test]
    fn an_answer_that_outlives_its_connection_leaves_nothing_behind() {
        let all = IdleConnections::default();
        let client = all.register();
        let running = client.begin_request();
        client.end();
        drop(running);
        assert!(lock(&all.0).idle.is_empty());
    }
}
