use burn::tensor::Tensor;
use rayon::prelude::*;

use super::conv1d::Conv1d;
use super::fused::{Array, FusedOp, apply, operand};
use super::group_norm_mish::GroupNormMish;
use super::packed::PackedKernel;
use super::{conv1d, group_norm_mish, vectorized};

/// The factor and the term that a condition gives each channel of each trajectory, both `[batch,
/// channel, 1]`. The product comes before the sum.
#[derive(Clone, Debug)]
pub struct PerChannel {
    pub scale: Option<Tensor<3>>,
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
/// convolution, dh = scale dz, and of each channel of a trajectory, dscale = Σ dz h and dshift =
/// Σ dz. dx and the norm's gradients follow from dh.
#[derive(Clone, Debug)]
struct NormConv1d {
    norm: GroupNormMish,
    conv: Conv1d,
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
        let (samples, dz_values) = (dz.width(), dz.values());
        let per_trajectory = shift.values().len() / shift.shape()[0];
        let each_dz = dz_values.par_chunks(per_trajectory * samples);

        let mut d_shift = vec![0.0; shift.values().len()];
        let shifts = d_shift.par_chunks_mut(per_trajectory);
        shifts.zip(each_dz.clone()).for_each(|(sums, dz)| vectorized::row_sums(dz, samples, sums));

        let (dh, d_scale) = match scale {
            None => (dz, None),
            Some(scale) => {
                // h is computed once more here, because h and z together would need twice the memory.
                let mut dh = self.norm.values(&norm, |_, _| ());
                let mut d_scale = vec![0.0; scale.values().len()];
                d_scale
                    .par_chunks_mut(per_trajectory)
                    .zip(scale.values().par_chunks(per_trajectory))
                    .zip(dh.par_chunks_mut(per_trajectory * samples).zip(each_dz))
                    .for_each(|((sums, scale), (h, dz))| {
                        vectorized::products_of_rows(h, dz, samples, sums);
                        h.copy_from_slice(dz);
                        vectorized::multiply_rows(h, samples, scale);
                    });
                let d_scale = Array::new(d_scale, scale.shape());
                (Array::new(dh, norm[0].shape()), Some(d_scale))
            }
        };
        let d_shift = Array::new(d_shift, shift.shape());
        Gradients { norm: self.norm.backward(&norm, &dh), d_scale, d_shift, d_weight, d_bias }
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
