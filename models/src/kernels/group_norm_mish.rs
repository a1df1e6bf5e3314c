use burn::tensor::Tensor;

use super::mish;

/// PyTorch's default, added to the variance.
const EPSILON: f32 = 1e-5;

/// Mish of the group-normalized x (Wu and He 2018) `[batch, channel, sample]`: each of `groups`
/// sets of neighbouring channels to mean 0 and biased variance 1 over channels and samples, then
/// times weight plus bias, both `[channel]`.
pub(crate) fn group_norm_mish(
    x: Tensor<3>,
    weight: Tensor<1>,
    bias: Tensor<1>,
    groups: usize,
) -> Tensor<3> {
    plain(x, weight, bias, groups)
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
