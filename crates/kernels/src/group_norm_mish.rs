//! Group normalization, followed by Mish.

use burn::tensor::Tensor;

use super::fused::{Array, FusedOp, apply, operand};
use super::parts::{each_part, in_parts};
use super::vectorized::ChannelGradients;
use super::{mish, vectorized};

/// PyTorch's default, added to the variance.
pub(super) const EPSILON: f32 = 1e-5;

/// Mish of the group-normalized x (Wu and He 2018) `[batch, channel, sample]`. Each of `groups`
/// sets of neighbouring channels is normalized to mean 0 and biased variance 1 over channels and
/// samples. The result is multiplied by weight and bias is added, both `[channel]`.
pub fn group_norm_mish(
    x: Tensor<3>,
    weight: Tensor<1>,
    bias: Tensor<1>,
    groups: usize,
) -> Tensor<3> {
    apply(GroupNormMish { groups }, [operand(&x), operand(&weight), operand(&bias)])
        .unwrap_or_else(|| plain(x, weight, bias, groups))
}

pub(super) fn plain(x: Tensor<3>, weight: Tensor<1>, bias: Tensor<1>, groups: usize) -> Tensor<3> {
    let [batch, channels, samples] = x.dims();
    let grouped = x.reshape([batch, groups, channels / groups * samples]);
    let centred = grouped.clone() - grouped.mean_dim(2);
    let variance = centred.clone().square().mean_dim(2);
    let normed = (centred / (variance + EPSILON).sqrt()).reshape([batch, channels, samples]);
    let scaled = normed * weight.reshape([1, channels, 1]) + bias.reshape([1, channels, 1]);
    mish::plain(scaled)
}

/// A task is one group of one trajectory, which stays in the cache. The backward pass computes
/// mean, deviation and Mish's slope again from x, so that only x is kept.
#[derive(Clone, Debug)]
pub(super) struct GroupNormMish {
    pub groups: usize,
}

impl GroupNormMish {
    /// The values of the result. `then` is called with those of a group, and with the index of its
    /// first channel among the channels of all trajectories.
    pub fn values(
        &self,
        [x, weight, bias]: &[Array; 3],
        then: impl Fn(&mut [f32], usize) + Send + Sync,
    ) -> Vec<f32> {
        let channels = weight.width() / self.groups;
        let task = channels * x.width();
        each_part(x.values().len(), task, |index, y| {
            let x = &x.values()[index * task..][..y.len()];
            let group = index % self.groups * channels;
            let weight = &weight.values()[group..group + channels];
            let bias = &bias.values()[group..group + channels];
            vectorized::group_norm_mish(x, weight, bias, EPSILON, y);
            then(y, index * channels);
        })
    }

    /// The gradients of scale y + shift, where y is the result. Scale and shift have a number for
    /// each channel of each trajectory.
    pub fn gradients(
        &self,
        [x, weight, bias]: [&Array; 3],
        scale: Option<&Array>,
        dy: &Array,
    ) -> GroupNormGradients {
        let all_channels = weight.width();
        let channels = all_channels / self.groups;
        let task = channels * x.width();
        let (dx, sums) = in_parts(
            x.values().len(),
            task,
            || (),
            |(), index, dx| {
                let here = index * task..index * task + dx.len();
                let (x, dy) = (&x.values()[here.clone()], &dy.values()[here]);
                let group = index % self.groups * channels;
                let weight = &weight.values()[group..group + channels];
                let bias = &bias.values()[group..group + channels];
                let scale =
                    scale.map_or(&[][..], |scale| &scale.values()[index * channels..][..channels]);
                let mut sums = [(); 4].map(|()| vec![0.0; channels]);
                let [d_weight, d_bias, d_scale, d_shift] = &mut sums;
                let gradients = ChannelGradients {
                    weight: d_weight,
                    bias: d_bias,
                    scale: d_scale,
                    shift: d_shift,
                };
                vectorized::group_norm_mish_gradient(
                    x,
                    [weight, bias],
                    scale,
                    EPSILON,
                    dy,
                    dx,
                    gradients,
                );
                sums
            },
        );
        // The sums of each channel of each trajectory.
        let mut all = [(); 4].map(|()| Vec::with_capacity(x.values().len() / x.width()));
        for sums in sums {
            for (all, sums) in all.iter_mut().zip(sums) {
                all.extend(sums);
            }
        }
        let [weight_parts, bias_parts, d_scale, d_shift] = all;
        let (mut d_weight, mut d_bias) = (vec![0.0; all_channels], vec![0.0; all_channels]);
        vectorized::add_rows(&weight_parts, all_channels, &mut d_weight);
        vectorized::add_rows(&bias_parts, all_channels, &mut d_bias);
        GroupNormGradients {
            x: Array::new(dx, x.shape()),
            weight: Array::new(d_weight, weight.shape()),
            bias: Array::new(d_bias, bias.shape()),
            scale: d_scale,
            shift: d_shift,
        }
    }
}

/// The gradients of [`GroupNormMish::gradients`].
pub(super) struct GroupNormGradients {
    pub x: Array,
    pub weight: Array,
    pub bias: Array,
    /// Zeros without a scale.
    pub scale: Vec<f32>,
    pub shift: Vec<f32>,
}

impl FusedOp<3> for GroupNormMish {
    fn forward(&self, inputs: &[Array; 3]) -> Array {
        let [x, ..] = inputs;
        Array::new(self.values(inputs, |_, _| ()), x.shape())
    }

    fn backward(&self, inputs: &[Array; 3], dy: &Array) -> [Array; 3] {
        let GroupNormGradients { x, weight, bias, .. } =
            self.gradients(inputs.each_ref(), None, dy);
        [x, weight, bias]
    }
}
