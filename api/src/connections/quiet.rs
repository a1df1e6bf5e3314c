//! Idle connections: they have no running request, and wait for the next one. If there is no room
//! for a new connection, the connection that has been idle for longest is closed.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio_util::sync::CancellationToken;

/// The quiet connections, ordered by the time since when they are quiet.
#[derive(Clone, Default)]
pub struct QuietOnes(Arc<Mutex<Line>>);

#[derive(Default)]
struct Line {
    next: u64,
    quiet: BTreeMap<u64, CancellationToken>,
    /// A new connection waits for a place, and none was quiet. The next one to become quiet gives
    /// its place.
    is_wanted: bool,
}

/// A connection, which is quiet until a request comes.
pub struct Visitor {
    all: QuietOnes,
    close: CancellationToken,
    standing: Mutex<Standing>,
    has_asked: AtomicBool,
}

enum Standing {
    Quiet(u64),
    Busy,
    Gone,
}

/// A running request, with its answer.
pub struct Asking(Arc<Visitor>);

impl QuietOnes {
    /// Registers a connection that has got a place.
    pub fn visitor(&self) -> Arc<Visitor> {
        let close = CancellationToken::new();
        let mut line = lock(&self.0);
        line.is_wanted = false;
        let standing = Mutex::new(Standing::Quiet(line.enter(&close)));
        drop(line);
        Arc::new(Visitor { all: self.clone(), close, standing, has_asked: AtomicBool::new(false) })
    }

    /// Closes the connection that has been quiet for longest. If none is quiet, closes the next one
    /// that becomes quiet, unless a place becomes free before.
    pub fn close_one(&self) {
        let mut line = lock(&self.0);
        match line.quiet.pop_first() {
            Some((_, close)) => close.cancel(),
            None => line.is_wanted = true,
        }
    }

    fn leave(&self, number: u64) {
        lock(&self.0).quiet.remove(&number);
    }
}

impl Line {
    fn enter(&mut self, close: &CancellationToken) -> u64 {
        let number = self.next;
        self.next += 1;
        if std::mem::take(&mut self.is_wanted) {
            close.cancel();
        } else {
            self.quiet.insert(number, close.clone());
        }
        number
    }
}

impl Visitor {
    /// Completes when the connection has to be closed for another one.
    pub async fn unwanted(&self) {
        self.close.cancelled().await;
    }

    /// Marks the connection as having a request, until the returned value is dropped.
    pub fn asks(self: &Arc<Self>) -> Asking {
        self.has_asked.store(true, Ordering::Relaxed);
        self.change(Standing::Busy);
        if self.close.is_cancelled() {
            // The place was promised to another connection, which now needs a different one.
            self.all.close_one();
        }
        Asking(Arc::clone(self))
    }

    /// Whether a part of an answer may still be on its way.
    pub fn has_asked(&self) -> bool {
        self.has_asked.load(Ordering::Relaxed)
    }

    /// Whether a request is running.
    pub fn is_asking(&self) -> bool {
        matches!(*lock(&self.standing), Standing::Busy)
    }

    /// The connection is closed, or uses another protocol than HTTP.
    pub fn goes(&self) {
        self.change(Standing::Gone);
    }

    fn change(&self, to: Standing) {
        let mut standing = lock(&self.standing);
        if let Standing::Quiet(number) = *standing {
            self.all.leave(number);
        }
        *standing = to;
    }
}

impl Drop for Asking {
    fn drop(&mut self) {
        let Visitor { all, close, standing, .. } = &*self.0;
        let mut standing = lock(standing);
        if matches!(*standing, Standing::Busy) {
            *standing = Standing::Quiet(lock(&all.0).enter(close));
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
    fn the_one_that_was_quiet_for_longest_goes_and_nobody_who_asks() {
        let all = QuietOnes::default();
        let (first, second, third) = (all.visitor(), all.visitor(), all.visitor());
        let asking = first.asks();
        third.goes();
        all.close_one();
        assert!(second.close.is_cancelled() && !first.close.is_cancelled());
        // None is quiet until the first has its answer.
        all.close_one();
        assert!(!first.close.is_cancelled() && !third.close.is_cancelled());
        drop(asking);
        assert!(first.close.is_cancelled());
        // One place was wanted, not every place.
        assert!(!all.visitor().close.is_cancelled());
    }

    #[test]
    fn one_whose_request_comes_as_it_is_closed_leaves_that_to_the_next() {
        let all = QuietOnes::default();
        let (first, second) = (all.visitor(), all.visitor());
        all.close_one();
        assert!(first.close.is_cancelled() && !second.close.is_cancelled());
        let _asking = first.asks();
        assert!(second.close.is_cancelled());
    }

    #[test]
    fn whoever_has_got_a_place_that_became_free_keeps_it() {
        let all = QuietOnes::default();
        let only = all.visitor();
        let asking = only.asks();
        all.close_one();
        only.goes();
        drop(asking);
        assert!(!all.visitor().close.is_cancelled());
    }

    #[test]
    fn an_answer_that_outlives_its_connection_leaves_nothing_behind() {
        let all = QuietOnes::default();
        let visitor = all.visitor();
        let asking = visitor.asks();
        visitor.goes();
        drop(asking);
        assert!(lock(&all.0).quiet.is_empty());
    }
}
