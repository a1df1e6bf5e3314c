use kernels::{DropoutKeys, DropoutMask};

use crate::activations::Activations;

/// Gives each layer of a network its dropout mask, in the order of a pass.
pub(crate) struct Dropout {
    /// The keys of the trajectories; `None` outside training.
    keys: Option<DropoutKeys>,
    /// The share of values that blocks drop.
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

    /// The mask of the next layer in a block.
    pub fn mask(&mut self) -> Option<DropoutMask> {
        self.mask_at(self.rate)
    }

    /// Applies dropout to `x` in the next layer of a block.
    pub fn apply<A: Activations>(&mut self, x: A) -> A {
        self.apply_at(self.rate, x)
    }

    /// Applies dropout to `x` in the next layer, at `rate`.
    pub fn apply_at<A: Activations>(&mut self, rate: f64, x: A) -> A {
        let Some(mask) = self.mask_at(rate) else { return x };
        let shape = x.dims();
        A::operation([x], [false], shape, |[x]| kernels::dropout(x, Some(mask)))
    }

    /// The mask of the next layer.
    fn mask_at(&mut self, rate: f64) -> Option<DropoutMask> {
        let place = self.places;
        self.places += 1;
        let keys = self.keys.as_ref().filter(|_| rate > 0.0)?;
        Some(DropoutMask::new(keys.clone(), place, rate))
    }
}
