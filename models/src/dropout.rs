use kernels::{DropoutKeys, DropoutMask};

use crate::activations::Activations;

/// Hands each place of a network its mask, in the order of a pass.
pub(crate) struct Dropout {
    /// Of the trajectories; none where nothing is learned.
    keys: Option<DropoutKeys>,
    /// Of what blocks leave out.
    rate: f64,
    places: u32,
}

impl Dropout {
    pub fn new(keys: Option<DropoutKeys>, rate: f64) -> Self {
        Self { keys, rate, places: 0 }
    }

    pub fn off() -> Self {
        Self::new(None, 0.0)
    }

    /// Of the next place in a block.
    pub fn mask(&mut self) -> Option<DropoutMask> {
        self.mask_at(self.rate)
    }

    /// `x` without what the next place in a block leaves out.
    pub fn apply<A: Activations>(&mut self, x: A) -> A {
        self.apply_at(self.rate, x)
    }

    /// `x` without what the next place leaves out.
    pub fn apply_at<A: Activations>(&mut self, rate: f64, x: A) -> A {
        let Some(mask) = self.mask_at(rate) else { return x };
        let shape = x.dims();
        A::operation([x], [false], shape, |[x]| kernels::dropout(x, Some(mask)))
    }

    /// Of the next place.
    fn mask_at(&mut self, rate: f64) -> Option<DropoutMask> {
        let place = self.places;
        self.places += 1;
        let keys = self.keys.as_ref().filter(|_| rate > 0.0)?;
        Some(DropoutMask::new(keys.clone(), place, rate))
    }
}
