use burn::module::{Module, Param};
use burn::tensor::Tensor;
use kernels::{DropoutMask, PackedWeight};

use crate::initialization::InitialWeights;

/// `y = x Wᵀ + b`, with parameter names, layout and initial weights of `torch.nn.Linear`.
///
/// burn's own `Linear` keeps W transposed. With this one a checkpoint is the parameters as they
/// are, and loads into PyTorch without a word of translation.
#[derive(Module, Debug)]
pub(crate) struct Linear {
    /// `[output, input]`
    weight: Param<Tensor<2>>,
    /// `[output]`
    bias: Param<Tensor<1>>,
    #[module(skip)]
    packed: PackedWeight,
}

impl Linear {
    /// Weights and biases uniform on ±1/√input.
    pub fn new(input: usize, output: usize, weights: &mut InitialWeights<'_>) -> Self {
        let bound = 1.0 / (input as f32).sqrt();
        Self {
            weight: weights.uniform([output, input], bound),
            bias: weights.uniform([output], bound),
            packed: PackedWeight::default(),
        }
    }

    /// `[batch, token, input]` to `[batch, token, output]`.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        kernels::linear(x, self.weight.val(), self.bias.val(), &self.packed)
    }

    /// Of the normed x.
    pub fn forward_normed(&self, x: Tensor<3>, norm: &LayerNorm) -> Tensor<3> {
        let LayerNorm { weight, bias } = norm;
        let norm = [weight.val(), bias.val()];
        kernels::norm_linear(x, norm, self.weight.val(), self.bias.val(), &self.packed)
    }

    /// Three of the same normed x, their outputs side by side. `packed` is theirs together.
    pub fn forward_three_normed(
        maps: [&Self; 3],
        x: Tensor<3>,
        norm: &LayerNorm,
        packed: &PackedWeight,
    ) -> Tensor<3> {
        let norm = [norm.weight.val(), norm.bias.val()];
        let (weights, biases) = (maps.map(|map| map.weight.val()), maps.map(|map| map.bias.val()));
        kernels::norm_linear_of_three(x, norm, weights, biases, packed)
    }

    /// `residual` plus this of GELU of x; `masks` leave out numbers of GELU's and of this one's.
    pub fn forward_gelu_onto(
        &self,
        residual: Tensor<3>,
        x: Tensor<3>,
        masks: [Option<DropoutMask>; 2],
    ) -> Tensor<3> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        kernels::gelu_linear_onto(residual, x, weight, bias, &self.packed, masks)
    }

    pub const fn parameter_count(input: u64, output: u64) -> u64 {
        input * output + output
    }
}

/// Layer normalization over the last dimension (Ba et al. 2016), with the names and ε of
/// `torch.nn.LayerNorm`.
#[derive(Module, Debug)]
pub(crate) struct LayerNorm {
    /// `[width]`, initially 1.
    weight: Param<Tensor<1>>,
    /// `[width]`, initially 0.
    bias: Param<Tensor<1>>,
}

impl LayerNorm {
    pub fn new(width: usize, weights: &InitialWeights<'_>) -> Self {
        Self { weight: weights.constant([width], 1.0), bias: weights.constant([width], 0.0) }
    }

    /// `[batch, token, width]` to the same shape.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        kernels::layer_norm(x, self.weight.val(), self.bias.val())
    }

    pub const fn parameter_count(width: u64) -> u64 {
        2 * width
    }
}
