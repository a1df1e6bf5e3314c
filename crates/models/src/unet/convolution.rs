use burn::module::{Module, Param};
use burn::tensor::Tensor;
use kernels::{PackedKernel, PerChannel};

use super::group_norm::GroupNormMish;
use crate::activations::Activations;
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
    pub fn forward<A: Activations>(&self, x: A) -> A {
        let shape = self.shape_from(&x);
        A::operation([x], [true], shape, |[x]| {
            let (weight, bias) = (self.weight.val(), self.bias.val());
            kernels::conv1d(x, weight, bias, self.stride, self.padding, &self.packed)
        })
    }

    /// The convolution after `norm`, a product with `scale` and a sum with `shift`, both `[batch,
    /// input, 1]`. It has stride 1 and pads `[batch, input, sample]` to `[batch, output, sample]`.
    pub fn forward_normed<A: Activations>(
        &self,
        x: A,
        norm: &GroupNormMish,
        scale: Option<A>,
        shift: A,
    ) -> A {
        let shape = self.shape_from(&x);
        assert_eq!((self.stride, shape[2]), (1, x.dims()[2]), "the convolution keeps all samples");
        let compute = |x, scale, shift| {
            let (weight, bias) = (self.weight.val(), self.bias.val());
            let (groups, between) = (GroupNormMish::GROUPS, PerChannel { scale, shift });
            let norm = norm.parameters();
            kernels::norm_conv1d(x, norm, groups, between, weight, bias, &self.packed)
        };
        match scale {
            None => {
                A::operation([x, shift], [true; 2], shape, |[x, shift]| compute(x, None, shift))
            }
            Some(scale) => {
                A::operation([x, scale, shift], [true; 3], shape, |[x, scale, shift]| {
                    compute(x, Some(scale), shift)
                })
            }
        }
    }

    /// The result's shape. Notes the operation's buffer.
    fn shape_from(&self, x: &impl Activations) -> [usize; 3] {
        let [batch, _, samples] = x.dims();
        let [output, input, kernel] = self.weight.lazy_shape().dims();
        x.works_with(kernels::scratch_of_conv1d([output, input, kernel]));
        [batch, output, (samples + 2 * self.padding - kernel) / self.stride + 1]
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
    pub fn forward<A: Activations>(&self, x: A) -> A {
        let [batch, _, samples] = x.dims();
        let [_, output, kernel] = self.weight.lazy_shape().dims();
        let Self { stride, padding, .. } = *self;
        let shape = [batch, output, (samples - 1) * stride + kernel - 2 * padding];
        A::operation([x], [true], shape, |[x]| {
            let (weight, bias) = (self.weight.val(), self.bias.val());
            kernels::conv_transpose1d(x, weight, bias, stride, padding)
        })
    }
}
