//! Convolutions of normed and modulated inputs.

use burn::tensor::Tensor;

use super::conv1d::Conv1d;
use super::fused::{Array, FusedOp, apply, operand};
use super::group_norm_mish::GroupNormMish;
use super::packed::PackedKernel;
use super::{conv1d, group_norm_mish, vectorized};

/// The factor and the term that a condition gives each channel of each trajectory, both `[batch,
/// channel, 1]`. The product comes before the sum.
#[derive(Clone, Debug)]
pub struct PerChannel {
    /// The factor; 1 if there is none.
    pub scale: Option<Tensor<3>>,
    /// The summand.
    pub shift: Tensor<3>,
}

/// [`super::conv1d`] of [`super::group_norm_mish`] of x `[batch, input, sample]`, with `between`
/// applied between the two. Nothing between them is stored. The backward pass computes it again.
///
/// The convolution has stride 1 and a kernel of odd length, with half of it as padding, so that the
/// result is `[batch, output, sample]`.
pub fn norm_conv1d(
    x: Tensor<3>,
    norm: [Tensor<1>; 2],
    groups: usize,
    between: PerChannel,
    weight: Tensor<3>,
    bias: Tensor<1>,
    packed: &PackedKernel,
) -> Tensor<3> {
    let [_, _, kernel] = weight.dims();
    let conv = Conv1d::new(1, kernel / 2, packed, weight.is_autodiff());
    let op = NormConv1d { norm: GroupNormMish { groups }, conv };
    let [norm_weight, norm_bias] = norm.each_ref().map(operand);
    let [x_operand, shift, kernel, of_channel] =
        [operand(&x), operand(&between.shift), operand(&weight), operand(&bias)];
    let fused = match &between.scale {
        None => apply(op, [x_operand, norm_weight, norm_bias, shift, kernel, of_channel]),
        Some(scale) => {
            let scale = operand(scale);
            apply(op, [x_operand, norm_weight, norm_bias, scale, shift, kernel, of_channel])
        }
    };
    fused.unwrap_or_else(|| plain(x, norm, groups, between, weight, bias))
}

pub(super) fn plain(
    x: Tensor<3>,
    [norm_weight, norm_bias]: [Tensor<1>; 2],
    groups: usize,
    PerChannel { scale, shift }: PerChannel,
    weight: Tensor<3>,
    bias: Tensor<1>,
) -> Tensor<3> {
    let [_, _, kernel] = weight.dims();
    let hidden = group_norm_mish::plain(x, norm_weight, norm_bias, groups);
    let hidden = match scale {
        None => hidden,
        Some(scale) => hidden * scale,
    };
    conv1d::plain(hidden + shift, weight, bias, 1, kernel / 2)
}

/// With h = Mish(norm(x)) and z = scale h + shift: dz and the kernel's gradient are those of the
/// convolution. The other gradients follow from dz.
#[derive(Clone, Debug)]
pub(super) struct NormConv1d {
    pub norm: GroupNormMish,
    pub conv: Conv1d,
}

impl NormConv1d {
    /// Computes z.
    fn between(&self, norm: &[Array; 3], scale: Option<&Array>, shift: &Array) -> Array {
        let [x, ..] = norm;
        let (samples, shifts) = (x.width(), shift.values());
        let z = self.norm.values(norm, |channels, first| {
            let here = first..first + channels.len() / samples;
            if let Some(scale) = scale {
                vectorized::multiply_rows(channels, samples, &scale.values()[here.clone()]);
            }
            vectorized::add_to_rows(channels, samples, &shifts[here]);
        });
        Array::new(z, x.shape())
    }

    fn backward_of(
        &self,
        norm: [&Array; 3],
        scale: Option<&Array>,
        shift: &Array,
        [weight, bias]: [&Array; 2],
        dy: &Array,
    ) -> Gradients {
        let norm = norm.map(Clone::clone);
        let z = self.between(&norm, scale, shift);
        let [dz, d_weight, d_bias] = self.conv.backward(&[z, weight.clone(), bias.clone()], dy);
        let norm = self.norm.gradients(norm.each_ref(), scale, &dz);
        Gradients {
            d_scale: scale.map(|scale| Array::new(norm.scale, scale.shape())),
            d_shift: Array::new(norm.shift, shift.shape()),
            norm: [norm.x, norm.weight, norm.bias],
            d_weight,
            d_bias,
        }
    }
}

struct Gradients {
    /// The gradients of x and of the norm's weight and bias.
    norm: [Array; 3],
    d_scale: Option<Array>,
    d_shift: Array,
    d_weight: Array,
    d_bias: Array,
}

impl FusedOp<6> for NormConv1d {
    fn forward(&self, [x, norm_weight, norm_bias, shift, weight, bias]: &[Array; 6]) -> Array {
        let norm = [x, norm_weight, norm_bias].map(Clone::clone);
        let z = self.between(&norm, None, shift);
        self.conv.forward(&[z, weight.clone(), bias.clone()])
    }

    fn backward(
        &self,
        [x, norm_weight, norm_bias, shift, weight, bias]: &[Array; 6],
        dy: &Array,
    ) -> [Array; 6] {
        let of = self.backward_of([x, norm_weight, norm_bias], None, shift, [weight, bias], dy);
        let [dx, d_norm_weight, d_norm_bias] = of.norm;
        [dx, d_norm_weight, d_norm_bias, of.d_shift, of.d_weight, of.d_bias]
    }
}

impl FusedOp<7> for NormConv1d {
    fn forward(
        &self,
        [x, norm_weight, norm_bias, scale, shift, weight, bias]: &[Array; 7],
    ) -> Array {
        let norm = [x, norm_weight, norm_bias].map(Clone::clone);
        let z = self.between(&norm, Some(scale), shift);
        self.conv.forward(&[z, weight.clone(), bias.clone()])
    }

    fn backward(
        &self,
        [x, norm_weight, norm_bias, scale, shift, weight, bias]: &[Array; 7],
        dy: &Array,
    ) -> [Array; 7] {
        let norm = [x, norm_weight, norm_bias];
        let of = self.backward_of(norm, Some(scale), shift, [weight, bias], dy);
        let [dx, d_norm_weight, d_norm_bias] = of.norm;
        let d_scale = of.d_scale.expect("with a scale there is its gradient");
        [dx, d_norm_weight, d_norm_bias, d_scale, of.d_shift, of.d_weight, of.d_bias]
    }
}
