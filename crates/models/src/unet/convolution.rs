//! Convolutions over the samples of a series.

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use kernels::{PackedKernel, PerChannel};

use crate::initialization::InitialWeights;

/// A convolution with the parameter names, layout and initial weights of `torch.nn.Conv1d`.
#[derive(Module, Debug)]
pub(crate) struct Conv1d {
    /// `[output, input, kernel]`
    weight: Param<Tensor<3>>,
    /// `[output]`
    bias: Param<Tensor<1>>,
    stride: usize,
    padding: usize,
    #[module(skip)]
    packed: PackedKernel,
}

impl Conv1d {
    /// Weights and biases uniform on ±1/√(input · kernel).
    pub fn new(
        input: usize,
        output: usize,
        kernel: usize,
        stride: usize,
        padding: usize,
        weights: &mut InitialWeights<'_>,
    ) -> Self {
        let bound = 1.0 / ((input * kernel) as f32).sqrt();
        Self {
            weight: weights.uniform([output, input, kernel], bound),
            bias: weights.uniform([output], bound),
            stride,
            padding,
            packed: PackedKernel::default(),
        }
    }

    /// `[batch, input, sample]` to `[batch, output, sample / stride]`.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        kernels::conv1d(x, weight, bias, self.stride, self.padding, &self.packed)
    }

    /// The convolution after `norm`, a product with `scale` and a sum with `shift`, both `[batch,
    /// input, 1]`. It has stride 1 and pads `[batch, input, sample]` to `[batch, output, sample]`.
    pub fn forward_normed(
        &self,
        x: Tensor<3>,
        norm: &GroupNormMish,
        scale: Option<Tensor<3>>,
        shift: Tensor<3>,
    ) -> Tensor<3> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        let (groups, between) = (GroupNormMish::GROUPS, PerChannel { scale, shift });
        kernels::norm_conv1d(x, norm.parameters(), groups, between, weight, bias, &self.packed)
    }

    /// The channels of input and output. They are known without the weights.
    pub fn channels(&self) -> [usize; 2] {
        let [output, input, _] = self.weight.lazy_shape().dims();
        [input, output]
    }
}

/// A transposed convolution with the parameter names, layout and initial weights of
/// `torch.nn.ConvTranspose1d`.
#[derive(Module, Debug)]
pub(crate) struct ConvTranspose1d {
    /// `[input, output, kernel]`
    weight: Param<Tensor<3>>,
    /// `[output]`
    bias: Param<Tensor<1>>,
    stride: usize,
    padding: usize,
}

impl ConvTranspose1d {
    /// Weights and biases uniform on ±1/√(output · kernel), as in PyTorch.
    pub fn new(
        input: usize,
        output: usize,
        kernel: usize,
        stride: usize,
        padding: usize,
        weights: &mut InitialWeights<'_>,
    ) -> Self {
        let bound = 1.0 / ((output * kernel) as f32).sqrt();
        Self {
            weight: weights.uniform([input, output, kernel], bound),
            bias: weights.uniform([output], bound),
            stride,
            padding,
        }
    }

    /// `[batch, input, sample]` to `[batch, output, sample · stride]`.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        kernels::conv_transpose1d(x, weight, bias, self.stride, self.padding)
    }
}

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
