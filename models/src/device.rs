/// Where tensors live and are computed.
#[derive(Clone, Debug)]
pub struct Device(burn::tensor::Device);

impl Device {
    /// The processor, through burn's `flex` backend. As many threads as rayon has.
    pub fn cpu() -> Self {
        Self(burn::tensor::Device::flex())
    }

    /// Computes values only.
    pub(crate) fn inference(&self) -> burn::tensor::Device {
        self.0.clone()
    }

    /// Computes values and records what their gradients need.
    pub(crate) fn training(&self) -> burn::tensor::Device {
        self.0.clone().autodiff()
    }
}
