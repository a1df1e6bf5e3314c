//! Weights that are packed once for all products of a step.

use std::borrow::Cow;
use std::sync::{Arc, Mutex, PoisonError};

use super::factors::Factors;
use super::fused::Array;
use super::panels::Panels;

/// A weight, or several side by side, packed for products and kept from one prediction to the next.
/// Packing a weight takes as long as its product with some dozen rows.
///
/// It also says which numbers the products read their factors as.
///
/// Only networks without gradients keep a packed weight. A clone begins empty, because its weights
/// may change.
#[derive(Debug, Default)]
pub struct PackedWeight {
    factors: Factors,
    kept: Arc<Kept<Panels>>,
}

/// The kernel of a convolution, transformed for tiles and kept from one prediction to the next like
/// a [`PackedWeight`].
#[derive(Debug, Default)]
pub struct PackedKernel(Arc<Kept<Vec<f32>>>);

/// A form of some weights that was made before.
#[derive(Debug)]
pub(super) struct Kept<T>(Mutex<Option<KeptForm<T>>>);

#[derive(Debug)]
struct KeptForm<T> {
    /// The weights. Holding them here protects their memory from writes and from reuse.
    weights: Vec<Array>,
    form: Arc<T>,
}

impl<T> Default for Kept<T> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl Clone for PackedWeight {
    fn clone(&self) -> Self {
        Self::new(self.factors)
    }
}

/// The source of an operation's packed weight: kept, or packed for each call.
#[derive(Clone, Debug)]
pub(super) struct Packing {
    pub factors: Factors,
    kept: Option<Arc<Kept<Panels>>>,
}

impl PackedWeight {
    /// Nothing is kept at first.
    pub fn new(factors: Factors) -> Self {
        Self { factors, kept: Arc::default() }
    }

    /// The numbers that products with this weight read their factors as.
    pub fn factors(&self) -> Factors {
        self.factors
    }

    /// The source for an operation on a weight. Weights that record gradients are packed for each
    /// call.
    pub(super) fn packing(&self, is_tracked: bool) -> Packing {
        let kept = (!is_tracked).then(|| Arc::clone(&self.kept));
        Packing { factors: self.factors, kept }
    }
}

impl Packing {
    /// W `[output, input]` as the right factor Wᵀ. Several weights are joined along their outputs.
    pub fn transposed(&self, weights: &[&Array]) -> Arc<Panels> {
        kept_or_made(self.kept.as_deref(), weights, || pack(self.factors, weights))
    }
}

impl Clone for PackedKernel {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl PackedKernel {
    /// The place for the transformed kernel of an operation. A kernel that records gradients is
    /// transformed for each call.
    pub(super) fn place(&self, is_tracked: bool) -> Option<Arc<Kept<Vec<f32>>>> {
        (!is_tracked).then(|| Arc::clone(&self.0))
    }
}

/// The form of `weights` that `kept` has, or that `make` makes. It is kept if there is a place.
///
/// Nothing is locked while it is made. `make` divides its work among threads, and a thread that
/// waits for its share may take up another operation on the same weights.
pub(super) fn kept_or_made<T>(
    kept: Option<&Kept<T>>,
    weights: &[&Array],
    make: impl FnOnce() -> T,
) -> Arc<T> {
    let Some(Kept(kept)) = kept else { return Arc::new(make()) };
    let lock = || kept.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(kept) = lock().as_ref().filter(|kept| kept.is_of(weights)) {
        return Arc::clone(&kept.form);
    }
    let form = Arc::new(make());
    let weights = weights.iter().map(|&weight| weight.clone()).collect();
    *lock() = Some(KeptForm { weights, form: Arc::clone(&form) });
    form
}

impl<T> KeptForm<T> {
    fn is_of(&self, weights: &[&Array]) -> bool {
        let place = |weight: &Array| weight.values().as_ptr();
        self.weights.len() == weights.len()
            && self.weights.iter().zip(weights).all(|(kept, asked)| place(kept) == place(asked))
    }
}

fn pack(factors: Factors, weights: &[&Array]) -> Panels {
    let input = weights[0].width();
    let all = side_by_side(weights);
    Panels::of_columns(factors, &all, [input, all.len() / input], input)
}

/// The rows of all arrays, which have the same width, one array after the other.
pub(super) fn side_by_side<'a>(arrays: &[&'a Array]) -> Cow<'a, [f32]> {
    match arrays {
        [only] => Cow::Borrowed(only.values()),
        several => {
            let values: Vec<&[f32]> = several.iter().map(|array| array.values()).collect();
            Cow::Owned(values.concat())
        }
    }
}
