//! The noise level as a network sees it.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use kernels::mish;

use crate::initialization::InitialWeights;
use crate::layers::Linear;

/// Longest period of [`sinusoid`] over 2π (Vaswani et al. 2017).
const LONGEST_PERIOD: f64 = 10_000.0;

/// Sines, then cosines, of each noise level at periods from 2π in geometric steps:
/// `[batch, 1, width]`, width even.
pub(crate) fn sinusoid(levels: &[usize], width: usize, device: &Device) -> Tensor<3> {
    let shape = [levels.len(), 1, width];
    Tensor::from_data(TensorData::new(waves(levels, width), shape), device)
}

#[expect(clippy::cast_possible_truncation, reason = "the network computes in f32")]
fn waves(levels: &[usize], width: usize) -> Vec<f32> {
    let half = width / 2;
    let rates = (0..half).map(|index| {
        let exponent = index as f64 / half.saturating_sub(1).max(1) as f64;
        LONGEST_PERIOD.powf(-exponent)
    });
    let rates: Vec<f64> = rates.collect();
    let mut values = Vec::with_capacity(levels.len() * width);
    for &level in levels {
        let angles = || rates.iter().map(|rate| level as f64 * rate);
        values.extend(angles().map(|angle| angle.sin() as f32));
        values.extend(angles().map(|angle| angle.cos() as f32));
    }
    values
}

/// The noise level as a U-Net sees it: a sinusoid, then two linear maps with Mish between.
#[derive(Module, Debug)]
pub(crate) struct LevelEmbedding {
    expand: Linear,
    contract: Linear,
    width: usize,
}

impl LevelEmbedding {
    pub fn new(width: usize, weights: &mut InitialWeights<'_>) -> Self {
        Self {
            expand: Linear::new(width, 4 * width, weights),
            contract: Linear::new(4 * width, width, weights),
            width,
        }
    }

    /// The embedding `[batch, 1, width]`.
    pub fn forward(&self, levels: &[usize], device: &Device) -> Tensor<3> {
        let sinusoid = sinusoid(levels, self.width, device);
        self.contract.forward(mish(self.expand.forward(sinusoid)))
    }

    /// The values that a training step keeps of a trajectory: the sinusoid, and the hidden values
    /// before and after Mish.
    pub fn kept(&self) -> usize {
        9 * self.width
    }
}
