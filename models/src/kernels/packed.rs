use std::sync::{Arc, Mutex, PoisonError};

use super::fused::Array;
use super::panels::Panels;

/// A weight as products want it, kept from one prediction to the next: to rearrange the weights
/// takes as long as to multiply them with some dozen rows.
///
/// Only networks that record no gradients keep theirs. A clone begins with nothing, so that it is
/// free to have other weights.
#[derive(Debug, Default)]
pub(crate) struct PackedWeight(Arc<Mutex<Option<Kept>>>);

#[derive(Debug)]
struct Kept {
    /// While it is held here, nothing writes to its memory, and no other weight can be there.
    weight: Array,
    panels: Arc<Panels>,
}

impl Clone for PackedWeight {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// How an operation comes by the columns of its weight.
#[derive(Clone, Debug)]
pub(super) struct Packing(Option<Arc<Mutex<Option<Kept>>>>);

impl PackedWeight {
    /// For an operation on a weight that does or does not record gradients.
    pub(super) fn packing(&self, is_tracked: bool) -> Packing {
        Packing((!is_tracked).then(|| Arc::clone(&self.0)))
    }
}

impl Packing {
    /// W `[output, input]` as the right factor Wᵀ.
    pub fn transposed(&self, weight: &Array) -> Arc<Panels> {
        let [output, input] = *weight.shape() else { unreachable!("of rank 2") };
        let pack = || Arc::new(Panels::of_columns(weight.values(), input, output, input));
        let Some(kept) = &self.0 else { return pack() };
        let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
        match &*kept {
            Some(kept) if kept.weight.values().as_ptr() == weight.values().as_ptr() => {
                Arc::clone(&kept.panels)
            }
            _ => {
                let panels = pack();
                *kept = Some(Kept { weight: weight.clone(), panels: Arc::clone(&panels) });
                panels
            }
        }
    }
}
