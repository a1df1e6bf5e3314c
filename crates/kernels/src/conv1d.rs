//! Convolutions over the samples of series.

use std::sync::Arc;

use burn::tensor::ops::ConvOptions;
use burn::tensor::{Tensor, module};

use super::correlation::{Correlation, channel_sums};
use super::fused::{Array, FusedOp, apply, operand};
use super::packed::{Kept, PackedKernel, kept_or_made};
use super::winograd;

/// Cross-correlation along the last dimension, zeros beyond the ends, as `torch.nn.Conv1d`:
/// x `[batch, input, sample]` with weight `[output, input, kernel]` and bias `[output]` to
/// `[batch, output, (sample + 2 padding - kernel) / stride + 1]`.
pub fn conv1d(
    x: Tensor<3>,
    weight: Tensor<3>,
    bias: Tensor<1>,
    stride: usize,
    padding: usize,
    packed: &PackedKernel,
) -> Tensor<3> {
    let operands = [operand(&x), operand(&weight), operand(&bias)];
    apply(Conv1d::new(stride, padding, packed, weight.is_autodiff()), operands)
        .unwrap_or_else(|| plain(x, weight, bias, stride, padding))
}

/// The size of the largest temporary buffer of [`conv1d`] with a weight of this shape and of its
/// backward pass, whatever the batch.
pub fn scratch_of_conv1d(weight: [usize; 3]) -> usize {
    winograd::scratch(weight)
}

pub(super) fn plain(
    x: Tensor<3>,
    weight: Tensor<3>,
    bias: Tensor<1>,
    stride: usize,
    padding: usize,
) -> Tensor<3> {
    module::conv1d(x, weight, Some(bias), ConvOptions::new([stride], [padding], [1], 1))
}

/// dx is the adjoint correlation of dy, db = Σ dy over trajectories and samples.
#[derive(Clone, Debug)]
pub(super) struct Conv1d {
    pub stride: usize,
    pub padding: usize,
    /// The place for the kernel at the points of tiles.
    at_points: Option<Arc<Kept<Vec<f32>>>>,
}

impl Conv1d {
    pub fn new(stride: usize, padding: usize, packed: &PackedKernel, is_tracked: bool) -> Self {
        Self { stride, padding, at_points: packed.place(is_tracked) }
    }

    fn correlation(&self, x: &Array, weight: &Array) -> Correlation {
        let [_, fine_channels, fine_samples] = *x.shape() else { unreachable!("of rank 3") };
        let [coarse_channels, _, kernel] = *weight.shape() else { unreachable!("of rank 3") };
        Correlation {
            fine_channels,
            fine_samples,
            coarse_channels,
            coarse_samples: (fine_samples + 2 * self.padding - kernel) / self.stride + 1,
            kernel,
            stride: self.stride,
            padding: self.padding,
        }
    }
}

impl FusedOp<3> for Conv1d {
    fn forward(&self, [x, weight, bias]: &[Array; 3]) -> Array {
        let correlation = self.correlation(x, weight);
        let Correlation { coarse_channels, coarse_samples, .. } = correlation;
        let (batch, bias) = (x.shape()[0], Some(bias.values()));
        let y = if correlation.is_tiled() {
            let make = || correlation.at_points(weight.values());
            let kernel = kept_or_made(self.at_points.as_deref(), &[weight], make);
            correlation.forward_tiled(x.values(), &kernel, bias)
        } else {
            correlation.forward(x.values(), weight.values(), bias)
        };
        Array::new(y, &[batch, coarse_channels, coarse_samples])
    }

    fn backward(&self, [x, weight, bias]: &[Array; 3], dy: &Array) -> [Array; 3] {
        let correlation = self.correlation(x, weight);
        let dx = correlation.adjoint(dy.values(), weight.values(), None);
        let d_weight = correlation.kernel_gradient(x.values(), dy.values());
        let d_bias = channel_sums(dy.values(), bias.width(), dy.width());
        [
            Array::new(dx, x.shape()),
            Array::new(d_weight, weight.shape()),
            Array::new(d_bias, bias.shape()),
        ]
    }
}
