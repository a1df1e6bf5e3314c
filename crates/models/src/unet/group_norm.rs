//! Group normalization, followed by Mish.

use burn::module::{Module, Param};
use burn::tensor::Tensor;

use crate::initialization::InitialWeights;

/// Group normalization in 8 groups, followed by Mish. The parameters are those of
/// `torch.nn.GroupNorm`.
#[derive(Module, Debug)]
pub(super) struct GroupNormMish {
    /// `[channel]`, initially 1.
    weight: Param<Tensor<1>>,
    /// `[channel]`, initially 0.
    bias: Param<Tensor<1>>,
}

impl GroupNormMish {
    pub const GROUPS: usize = spec::GROUPS as usize;

    pub fn new(channels: usize, weights: &mut InitialWeights<'_>) -> Self {
        Self { weight: weights.constant([channels], 1.0), bias: weights.constant([channels], 0.0) }
    }

    pub fn parameters(&self) -> [Tensor<1>; 2] {
        [self.weight.val(), self.bias.val()]
    }

    /// `[batch, channel, sample]` to the same shape.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [weight, bias] = self.parameters();
        kernels::group_norm_mish(x, weight, bias, Self::GROUPS)
    }
}
