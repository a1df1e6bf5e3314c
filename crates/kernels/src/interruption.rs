//! Interrupting a computation.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Asks a computation to end early. Clones share one state.
///
/// A step of a large model takes long, and most of this time is inside burn, which cannot be
/// interrupted. So each operation of this crate checks the interrupt first, and unwinds the thread
/// to the beginning of the computation. Nothing has changed by then, because a step changes its
/// trainer only after all gradients are computed.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicBool>);

/// The error of an interrupted computation. Its thread also unwinds with this value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interrupted;

thread_local! {
    /// The interrupt of this thread's computation.
    static CURRENT: RefCell<Option<Interrupt>> = const { RefCell::new(None) };
}

impl Interrupt {
    /// Interrupts for good: running and later computations with this interrupt end with
    /// [`Interrupted`].
    pub fn raise(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the computation should end.
    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// The interrupt of this thread's computation, or a new one if the thread has no guard. Threads
    /// that compute a part of it are handed this one, as they have no guard of their own.
    pub fn current() -> Self {
        CURRENT.with_borrow(Clone::clone).unwrap_or_default()
    }

    /// If the interrupt is raised, unwinds to the [`Interrupt::guard`] of the computation. From a
    /// task of rayon, the unwinding continues in the thread that waits for the task.
    pub fn leave_if_raised(&self) {
        if self.is_raised() {
            // This unwinds without the message of a panic.
            resume_unwind(Box::new(Interrupted));
        }
    }

    /// Runs `work` on this thread. An interrupt ends it.
    ///
    /// # Errors
    /// [`Interrupted`], and the errors of `work`.
    pub fn guard<T, E: From<Interrupted>>(
        &self,
        work: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E> {
        let outer = CURRENT.replace(Some(self.clone()));
        let done = catch_unwind(AssertUnwindSafe(work));
        CURRENT.set(outer);
        match done {
            Ok(done) => done,
            Err(panic) if panic.is::<Interrupted>() => Err(Interrupted.into()),
            Err(panic) => resume_unwind(panic),
        }
    }
}

/// Unwinds this thread's computation if it is interrupted.
pub(crate) fn leave_if_interrupted() {
    CURRENT.with_borrow(|current| {
        if let Some(current) = current {
            current.leave_if_raised();
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interrupt_ends_what_it_guards_and_nothing_else() {
        let (raised, other) = (Interrupt::default(), Interrupt::default());
        raised.raise();
        let looks = || {
            leave_if_interrupted();
            Ok::<_, Interrupted>(1)
        };
        assert_eq!(raised.guard(looks), Err(Interrupted));
        assert_eq!(other.guard(looks), Ok(1));
        assert_eq!(raised.guard(|| other.guard(looks)), Ok(1));
        leave_if_interrupted();
    }

    #[test]
    fn threads_that_share_a_computation_leave_it_too() {
        use rayon::prelude::*;
        let interrupt = Interrupt::default();
        let done = interrupt.guard(|| {
            let current = Interrupt::current();
            let tasks = (0..100).into_par_iter().map(|task| {
                if task == 50 {
                    current.raise();
                }
                current.leave_if_raised();
                task
            });
            Ok::<i32, Interrupted>(tasks.sum())
        });
        assert_eq!(done, Err(Interrupted));
        assert!(!Interrupt::current().is_raised(), "nobody interrupts what is not guarded");
    }

    #[test]
    #[should_panic(expected = "a fault")]
    fn a_panic_of_another_kind_goes_on() {
        let _ = Interrupt::default().guard(|| -> Result<(), Interrupted> { panic!("a fault") });
    }
}
