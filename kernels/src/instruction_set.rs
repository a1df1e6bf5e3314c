//! Which of the kernels' compilations runs.

/// Instructions that kernels are compiled for beside those that every processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum InstructionSet {
    Avx512,
    /// With fused multiply-adds.
    Avx2,
    Plain,
}

impl InstructionSet {
    /// The best that the processor has.
    #[inline]
    pub fn detected() -> Self {
        #[cfg(test)]
        if let Some(chosen) = tests::chosen() {
            return chosen;
        }
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") {
                return Self::Avx512;
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                return Self::Avx2;
            }
        }
        Self::Plain
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::sync::atomic::{AtomicU8, Ordering};
    use std::sync::{PoisonError, RwLock, RwLockReadGuard};

    use super::InstructionSet;

    static CHOSEN: AtomicU8 = AtomicU8::new(0);
    static CHOOSING: RwLock<()> = RwLock::new(());

    pub(super) fn chosen() -> Option<InstructionSet> {
        match CHOSEN.load(Ordering::Relaxed) {
            1 => Some(InstructionSet::Avx512),
            2 => Some(InstructionSet::Avx2),
            3 => Some(InstructionSet::Plain),
            _ => None,
        }
    }

    /// While it is held, every thread of the process uses the best instructions.
    pub(in super::super) fn unchanged() -> RwLockReadGuard<'static, ()> {
        CHOOSING.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// `action` on every instruction set that this processor has, the others' kernels left aside.
    pub(in super::super) fn with_each(mut action: impl FnMut(InstructionSet)) {
        let _guard = CHOOSING.write().unwrap_or_else(PoisonError::into_inner);
        let best = InstructionSet::detected();
        let all = [InstructionSet::Avx512, InstructionSet::Avx2, InstructionSet::Plain];
        for (number, set) in (1..).zip(all).skip_while(|(_, set)| *set != best) {
            CHOSEN.store(number, Ordering::Relaxed);
            action(set);
        }
        CHOSEN.store(0, Ordering::Relaxed);
    }
}
