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
    let raised = CURRENT.with_borrow(|current| current.as_ref().is_some_and(Interrupt::is_raised));
    if raised {
        // Without the message of a panic, which this is not.
        resume_unwind(Box::new(Interrupted));
    }
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
    #[should_panic(expected = "a fault")]
    fn a_panic_of_another_kind_goes_on() {
        let _ = Interrupt::default().guard(|| -> Result<(), Interrupted> { panic!("a fault") });
    }
}
