//! The choice of the compiled variant of a kernel.

use simd::InstructionSet;

/// The best instruction set of the processor.
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

    /// The index, from 1, of an available set; 0 for the best.
    static CHOSEN: AtomicUsize = AtomicUsize::new(0);
    static CHOOSING: RwLock<()> = RwLock::new(());

    pub(super) fn chosen() -> Option<InstructionSet> {
        let number = CHOSEN.load(Ordering::Relaxed).checked_sub(1)?;
        InstructionSet::available().get(number).copied()
    }

    /// While a thread holds this lock, every thread of the process uses the best instruction set.
    pub(in super::super) fn unchanged() -> RwLockReadGuard<'static, ()> {
        CHOOSING.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs `action` with every instruction set of this processor.
    pub(in super::super) fn with_each(mut action: impl FnMut(InstructionSet)) {
        let _guard = CHOOSING.write().unwrap_or_else(PoisonError::into_inner);
        for (number, set) in (1..).zip(InstructionSet::available()) {
            CHOSEN.store(number, Ordering::Relaxed);
            action(set);
        }
        CHOSEN.store(0, Ordering::Relaxed);
    }
}
