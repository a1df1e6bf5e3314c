use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Asks a computation to end before it is done. Clones are one and the same.
///
/// A step of a large model takes longer than anybody waits for it to end, and most of that time is
/// spent inside burn, which knows no way out. So each of our operations looks here first, and
/// unwinds the thread to where the computation began. Nothing was changed by then: a step changes
/// its trainer only when all gradients are there.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicBool>);

/// A computation ended before it was done. Also what its thread is unwound with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interrupted;

thread_local! {
    /// Who may interrupt what this thread computes.
    static CURRENT: RefCell<Option<Interrupt>> = const { RefCell::new(None) };
}

impl Interrupt {
    /// For good: what began or begins with this interrupt ends with [`Interrupted`].
    pub fn raise(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Whoever may interrupt the computation of this thread; nobody, unless it is guarded. Other threads
    /// that do a part of it look here, as they have no guard of their own.
    pub fn current() -> Self {
        CURRENT.with_borrow(Clone::clone).unwrap_or_default()
    }

    /// Leaves the computation, up to its [`Interrupt::guard`], if it is interrupted. Out of a task of rayon
    /// the way leads through the thread that waits for it.
    pub fn leave_if_raised(&self) {
        if self.is_raised() {
            // Without the message of a panic, which this is not.
            resume_unwind(Box::new(Interrupted));
        }
    }

    /// Does `work` on this thread, all of it or none.
    ///
    /// # Errors
    /// [`Interrupted`], and those of `work`.
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

/// Leaves the computation of this thread if it is interrupted.
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
