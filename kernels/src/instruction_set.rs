//! Which of the kernels' compilations runs.

use simd::InstructionSet;

/// The best instructions that the processor has.
#[inline]
pub(super) fn detected() -> InstructionSet {
    #[cfg(test)]
    if let Some(chosen) = tests::chosen() {
        return chosen;
    }
    InstructionSet::best()
}

#[cfg(test)]
pub(super) mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::{PoisonError, RwLock, RwLockReadGuard};

    use simd::InstructionSet;

    /// The number, from 1, of an available set; 0 for the best.
    static CHOSEN: AtomicUsize = AtomicUsize::new(0);
    static CHOOSING: RwLock<()> = RwLock::new(());

    pub(super) fn chosen() -> Option<InstructionSet> {
        let number = CHOSEN.load(Ordering::Relaxed).checked_sub(1)?;
        InstructionSet::available().get(number).copied()
    }

    /// While it is held, every thread of the process uses the best instructions.
    pub(in super::super) fn unchanged() -> RwLockReadGuard<'static, ()> {
        CHOOSING.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// `action` on every instruction set that this processor has, the others' kernels left aside.
    pub(in super::super) fn with_each(mut action: impl FnMut(InstructionSet)) {
        let _guard = CHOOSING.write().unwrap_or_else(PoisonError::into_inner);
        for (number, set) in (1..).zip(InstructionSet::available()) {
            CHOSEN.store(number, Ordering::Relaxed);
            action(set);
        }
        CHOSEN.store(0, Ordering::Relaxed);
    }
}
