//! Dropout, with a mask for each place in a network.

use burn::tensor::Tensor;
use kernels::{DropoutKeys, DropoutMask};

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
    pub fn apply(&mut self, x: Tensor<3>) -> Tensor<3> {
        self.apply_at(self.rate, x)
    }

    /// Applies dropout to `x` in the next layer, at `rate`.
    pub fn apply_at(&mut self, rate: f64, x: Tensor<3>) -> Tensor<3> {
        let mask = self.mask_at(rate);
        if mask.is_some() { kernels::dropout(x, mask) } else { x }
    }

    /// The mask of the next layer.
    fn mask_at(&mut self, rate: f64) -> Option<DropoutMask> {
        let place = self.places;
        self.places += 1;
        let keys = self.keys.as_ref().filter(|_| rate > 0.0)?;
        Some(DropoutMask::new(keys.clone(), place, rate))
    }
}
