//! Connections on which nothing is under way: those that wait for the head of a request. When there is no place for a new
//! one, the one goes that has waited for longest.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio_util::sync::CancellationToken;

/// The quiet connections, by when they became quiet.
#[derive(Clone, Default)]
pub struct QuietOnes(Arc<Mutex<Line>>);

#[derive(Default)]
struct Line {
    next: u64,
    quiet: BTreeMap<u64, CancellationToken>,
}

/// A connection, quiet until a request comes.
pub struct Visitor {
    all: QuietOnes,
    close: CancellationToken,
    standing: Mutex<Standing>,
}

enum Standing {
    Quiet(u64),
    Busy,
    Gone,
}

/// A request under way, with its answer.
pub struct Asking(Arc<Visitor>);

impl QuietOnes {
    pub fn visitor(&self) -> Arc<Visitor> {
        let close = CancellationToken::new();
        let number = self.enter(&close);
        Arc::new(Visitor {
            all: self.clone(),
            close,
            standing: Mutex::new(Standing::Quiet(number)),
        })
    }

    /// Has the connection closed that has been quiet for longest, if one is.
    pub fn close_one(&self) {
        if let Some((_, close)) = lock(&self.0).quiet.pop_first() {
            close.cancel();
        }
    }

    fn enter(&self, close: &CancellationToken) -> u64 {
        let mut line = lock(&self.0);
        let number = line.next;
        line.next += 1;
        line.quiet.insert(number, close.clone());
        number
    }

    fn leave(&self, number: u64) {
        lock(&self.0).quiet.remove(&number);
    }
}

impl Visitor {
    /// Done when the connection is to be closed for another.
    pub async fn unwanted(&self) {
        self.close.cancelled().await;
    }

    /// A request has come, and is under way until what this returns is dropped.
    pub fn asks(self: &Arc<Self>) -> Asking {
        self.change(Standing::Busy);
        Asking(Arc::clone(self))
    }

    /// The connection is closed, or speaks something else than HTTP.
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
        let Visitor { all, close, standing } = &*self.0;
        let mut standing = lock(standing);
        if matches!(*standing, Standing::Busy) {
            *standing = Standing::Quiet(all.enter(close));
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Nothing panics while it has the lock.
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
        // Nobody is quiet.
        all.close_one();
        assert!(!first.close.is_cancelled() && !third.close.is_cancelled());
        drop(asking);
        all.close_one();
        assert!(first.close.is_cancelled());
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
