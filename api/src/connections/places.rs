//! The places of connections. If there is no room for a new connection, one gives up its place: the
//! one that has been idle for longest, or else the one whose request has been without its body for
//! longest. A connection that has just come is idle until its request is read, so it is the last one
//! to be asked.

use std::collections::{BTreeMap, HashMap};
use std::net::IpAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use tokio_util::sync::CancellationToken;

use super::ARRIVAL;

/// The open connections.
#[derive(Clone)]
pub struct Places {
    line: Arc<Mutex<Line>>,
    /// Largest number of connections of one network.
    share: usize,
}

#[derive(Default)]
struct Line {
    next: u64,
    /// Connections without a request, in the order in which they became so.
    idle: BTreeMap<u64, Closable>,
    /// Connections whose request's body has not arrived, in the order in which the requests began.
    receiving: BTreeMap<u64, Closable>,
    /// Number of connections by network.
    networks: HashMap<IpAddr, usize>,
    /// Whether a new connection waits for a place. If so, the next connection that becomes idle is
    /// closed.
    next_is_closed: bool,
}

struct Closable {
    close: CancellationToken,
    network: Option<IpAddr>,
    since: Instant,
}

impl Closable {
    fn new(close: &CancellationToken, network: Option<IpAddr>) -> Self {
        Self { close: close.clone(), network, since: Instant::now() }
    }
}

/// A connection of a client. It is idle until a request comes.
pub struct ClientConnection {
    all: Places,
    close: CancellationToken,
    network: Option<IpAddr>,
    state: Mutex<ConnectionState>,
    has_had_request: AtomicBool,
}

#[derive(Clone, Copy)]
enum ConnectionState {
    Idle(u64),
    Receiving(u64),
    Busy,
    Ended,
}

/// Marks a request as running until its answer has been sent.
pub struct RunningRequest(Arc<ClientConnection>);

impl Places {
    pub fn new(share: usize) -> Self {
        Self { line: Arc::default(), share }
    }

    /// Whether a network may have one more connection. If it has its share, its connection that
    /// waits for longest is closed. If none waits, it may have no more.
    pub fn admit(&self, network: IpAddr) -> bool {
        let mut line = self.line();
        let count = line.networks.get(&network).copied().unwrap_or_default();
        count < self.share || line.close_first(Instant::now(), |of| of.network == Some(network))
    }

    /// Registers a connection that has got a place.
    pub fn register(&self, network: Option<IpAddr>) -> Arc<ClientConnection> {
        let close = CancellationToken::new();
        let mut line = self.line();
        line.next_is_closed = false;
        if let Some(network) = network {
            *line.networks.entry(network).or_default() += 1;
        }
        let state = Mutex::new(ConnectionState::Idle(line.enter_idle(&close, network)));
        drop(line);
        let (all, has_had_request) = (self.clone(), AtomicBool::new(false));
        Arc::new(ClientConnection { all, close, network, state, has_had_request })
    }

    /// Closes a connection that waits for its client. If none does, closes the next one that
    /// becomes idle, unless a place becomes free before.
    pub fn close_one(&self) {
        self.close_one_at(Instant::now());
    }

    fn close_one_at(&self, now: Instant) {
        let mut line = self.line();
        if !line.close_first(now, |_| true) {
            line.next_is_closed = true;
        }
    }

    fn line(&self) -> MutexGuard<'_, Line> {
        lock(&self.line)
    }
}

impl Line {
    fn number(&mut self) -> u64 {
        self.next += 1;
        self.next
    }

    fn enter_idle(&mut self, close: &CancellationToken, network: Option<IpAddr>) -> u64 {
        let number = self.number();
        if std::mem::take(&mut self.next_is_closed) {
            close.cancel();
        } else {
            self.idle.insert(number, Closable::new(close, network));
        }
        number
    }

    /// Closes the first connection that may be closed, and says whether there was one.
    fn close_first(&mut self, now: Instant, may_be: impl Fn(&Closable) -> bool) -> bool {
        let first = |waiting: &BTreeMap<u64, Closable>| {
            let mut waiting = waiting.iter().filter(|(_, closable)| may_be(closable));
            waiting.next().map(|(number, closable)| (*number, closable.since))
        };
        let (idle, receiving) = (first(&self.idle), first(&self.receiving));
        let settled = idle.filter(|(_, since)| now.saturating_duration_since(*since) >= ARRIVAL);
        let closed = match (settled, receiving, idle) {
            (Some((number, _)), _, _) | (None, None, Some((number, _))) => {
                self.idle.remove(&number)
            }
            (None, Some((number, _)), _) => self.receiving.remove(&number),
            (None, None, None) => None,
        };
        closed.inspect(|closable| closable.close.cancel()).is_some()
    }
}

impl ClientConnection {
    /// Completes when the connection has to be closed for another one.
    pub async fn close_requested(&self) {
        self.close.cancelled().await;
    }

    /// Marks the connection as having a request, until the returned value is dropped.
    pub fn begin_request(self: &Arc<Self>, has_body: bool) -> RunningRequest {
        self.has_had_request.store(true, Ordering::Relaxed);
        if has_body {
            let mut line = self.all.line();
            let number = line.number();
            // If the place is promised to another connection already, it gets this one's place
            // unless the body comes first.
            if !self.close.is_cancelled() {
                line.receiving.insert(number, Closable::new(&self.close, self.network));
            }
            drop(line);
            self.change(ConnectionState::Receiving(number));
        } else {
            self.be_busy();
        }
        RunningRequest(Arc::clone(self))
    }

    /// Lets the running request keep its place although its body has not arrived.
    pub fn keep(&self) {
        let is_receiving = matches!(*lock(&self.state), ConnectionState::Receiving(_));
        if is_receiving {
            self.be_busy();
        }
    }

    fn be_busy(&self) {
        self.change(ConnectionState::Busy);
        if self.close.is_cancelled() {
            // The place was promised to another connection, which now needs a different one.
            self.all.close_one();
        }
    }

    /// Whether a request was ever received. A part of its answer may still be on its way.
    pub fn has_had_request(&self) -> bool {
        self.has_had_request.load(Ordering::Relaxed)
    }

    /// Whether a request is running.
    pub fn has_running_request(&self) -> bool {
        matches!(*lock(&self.state), ConnectionState::Busy)
    }

    /// Whether a request waits for its body.
    pub fn is_receiving(&self) -> bool {
        matches!(*lock(&self.state), ConnectionState::Receiving(_))
    }

    /// Removes the connection: it is closed, or has switched from HTTP to another protocol.
    pub fn end(&self) {
        if matches!(self.change(ConnectionState::Ended), ConnectionState::Ended) {
            return;
        }
        let Some(network) = self.network else { return };
        let mut line = self.all.line();
        if let Some(count) = line.networks.get_mut(&network) {
            *count -= 1;
            if *count == 0 {
                line.networks.remove(&network);
            }
        }
    }

    /// Changes the state, and returns the one before.
    fn change(&self, to: ConnectionState) -> ConnectionState {
        let mut state = lock(&self.state);
        let before = std::mem::replace(&mut *state, to);
        match before {
            ConnectionState::Idle(number) => drop(self.all.line().idle.remove(&number)),
            ConnectionState::Receiving(number) => drop(self.all.line().receiving.remove(&number)),
            ConnectionState::Busy | ConnectionState::Ended => {}
        }
        before
    }
}

impl Drop for RunningRequest {
    fn drop(&mut self) {
        let ClientConnection { all, close, network, state, .. } = &*self.0;
        let mut state = lock(state);
        let mut line = all.line();
        match *state {
            ConnectionState::Busy => {}
            ConnectionState::Receiving(number) => drop(line.receiving.remove(&number)),
            ConnectionState::Idle(_) | ConnectionState::Ended => return,
        }
        *state = ConnectionState::Idle(line.enter_idle(close, *network));
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // No code panics while it holds the lock.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places() -> Places {
        Places::new(2)
    }

    #[test]
    fn the_longest_idle_connection_is_closed_and_none_with_a_request() {
        let all = places();
        let (first, second, third) = (all.register(None), all.register(None), all.register(None));
        let running = first.begin_request(false);
        third.end();
        all.close_one();
        assert!(second.close.is_cancelled() && !first.close.is_cancelled());
        // None is idle until the first has its answer.
        all.close_one();
        assert!(!first.close.is_cancelled() && !third.close.is_cancelled());
        drop(running);
        assert!(first.close.is_cancelled());
        // One place was wanted, not every place.
        assert!(!all.register(None).close.is_cancelled());
    }

    #[test]
    fn a_request_without_its_body_gives_up_its_place_when_none_is_idle() {
        let all = places();
        let (older, newer, idle) = (all.register(None), all.register(None), all.register(None));
        let _receiving = [older.begin_request(true), newer.begin_request(true)];
        all.close_one_at(Instant::now() + ARRIVAL);
        assert!(idle.close.is_cancelled() && !older.close.is_cancelled());
        all.close_one();
        assert!(older.close.is_cancelled() && older.is_receiving());
        newer.keep();
        all.close_one();
        assert!(!newer.close.is_cancelled(), "its place is kept");
    }

    /// Otherwise each connection of a flood would be closed for the next one after its whole time of
    /// arrival, and the requests of others would wait behind all of them.
    #[test]
    fn a_connection_that_has_just_come_is_the_last_to_be_closed() {
        let all = places();
        let (older, new) = (all.register(None), all.register(None));
        let _receiving = older.begin_request(true);
        all.close_one();
        assert!(older.close.is_cancelled() && !new.close.is_cancelled());
        all.close_one();
        assert!(new.close.is_cancelled());
    }

    #[test]
    fn a_request_whose_body_comes_as_it_is_closed_passes_that_to_the_next() {
        let all = places();
        let (first, second) = (all.register(None), all.register(None));
        let _receiving = [first.begin_request(true), second.begin_request(true)];
        all.close_one();
        assert!(first.close.is_cancelled() && !second.close.is_cancelled());
        first.keep();
        assert!(second.close.is_cancelled());
    }

    #[test]
    fn a_connection_whose_request_comes_as_it_is_closed_passes_that_to_the_next() {
        let all = places();
        let (first, second) = (all.register(None), all.register(None));
        all.close_one();
        assert!(first.close.is_cancelled() && !second.close.is_cancelled());
        let _request = first.begin_request(false);
        assert!(second.close.is_cancelled() && first.has_running_request());
    }

    #[test]
    fn half_a_request_that_comes_as_it_is_closed_does_not_save_its_connection() {
        let all = places();
        let (first, second) = (all.register(None), all.register(None));
        all.close_one();
        let _request = first.begin_request(true);
        assert!(first.is_receiving() && !second.close.is_cancelled());
        first.keep();
        assert!(second.close.is_cancelled(), "its body came");
    }

    #[test]
    fn a_connection_that_got_a_free_place_keeps_it() {
        let all = places();
        let only = all.register(None);
        let running = only.begin_request(false);
        all.close_one();
        only.end();
        drop(running);
        assert!(!all.register(None).close.is_cancelled());
    }

    #[test]
    fn an_answer_that_outlives_its_connection_leaves_nothing_behind() {
        let all = places();
        let client = all.register(None);
        let running = client.begin_request(true);
        client.end();
        drop(running);
        let line = all.line();
        assert!(line.idle.is_empty() && line.receiving.is_empty());
    }

    #[test]
    fn a_network_with_its_share_gives_up_a_place_of_its_own_or_gets_none() {
        let all = places();
        let (one, other): (IpAddr, IpAddr) =
            ("192.0.2.1".parse().unwrap(), "192.0.2.2".parse().unwrap());
        let before = all.register(Some(other));
        let (first, second) = (all.register(Some(one)), all.register(Some(one)));
        let _running = second.begin_request(false);
        assert!(all.admit(other));
        assert!(all.admit(one));
        assert!(first.close.is_cancelled() && !before.close.is_cancelled());
        assert!(!all.admit(one), "its other connection has a request");
        first.end();
        first.end();
        assert!(all.admit(one));
        drop(second);
        before.end();
        assert_eq!(all.line().networks.get(&other), None);
    }
}
