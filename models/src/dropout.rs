use kernels::{DropoutKeys, DropoutMask};

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

    /// Of the next place.
    pub fn mask_at(&mut self, rate: f64) -> Option<DropoutMask> {
        let place = self.places;
        self.places += 1;
        let keys = self.keys.as_ref().filter(|_| rate > 0.0)?;
        Some(DropoutMask::new(keys.clone(), place, rate))
    }
}
