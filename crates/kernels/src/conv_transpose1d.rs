//! Transposed convolutions over the samples of series.

use burn::tensor::ops::ConvTransposeOptions;
use burn::tensor::{Tensor, module};

use super::correlation::{Correlation, channel_sums};
use super::fused::{Array, FusedOp, apply, operand};

/// The adjoint of [`super::conv1d`] with the same stride and padding, as
/// `torch.nn.ConvTranspose1d`: x `[batch, input, sample]` with weight `[input, output, kernel]`
/// and bias `[output]` to `[batch, output, (sample - 1) stride - 2 padding + kernel]`.
pub fn conv_transpose1d(
    x: Tensor<3>,
    weight: Tensor<3>,
    bias: Tensor<1>,
    stride: usize,
    padding: usize,
) -> Tensor<3> {
    let operands = [operand(&x), operand(&weight), operand(&bias)];
    apply(ConvTranspose1d { stride, padding }, operands)
        .unwrap_or_else(|| plain(x, weight, bias, stride, padding))
}

pub(super) fn plain(
    x: Tensor<3>,
    weight: Tensor<3>,
    bias: Tensor<1>,
    stride: usize,
    padding: usize,
) -> Tensor<3> {
    let options = ConvTransposeOptions::new([stride], [padding], [0], [1], 1);
    module::conv_transpose1d(x, weight, Some(bias), options)
}

/// The backward pass is the correlation whose adjoint this is.
#[derive(Clone, Debug)]
pub(super) struct ConvTranspose1d {
    pub stride: usize,
    pub padding: usize,
}

impl ConvTranspose1d {
    fn correlation(&self, x: &Array, weight: &Array) -> Correlation {
        let [_, coarse_channels, coarse_samples] = *x.shape() else { unreachable!("of rank 3") };
        let [_, fine_channels, kernel] = *weight.shape() else { unreachable!("of rank 3") };
        Correlation {
            fine_channels,
            fine_samples: (coarse_samples - 1) * self.stride + kernel - 2 * self.padding,
            coarse_channels,
            coarse_samples,
            kernel,
            stride: self.stride,
            padding: self.padding,
        }
    }
}

impl FusedOp<3> for ConvTranspose1d {
    fn forward(&self, [x, weight, bias]: &[Array; 3]) -> Array {
        let correlation = self.correlation(x, weight);
        let Correlation { fine_channels, fine_samples, .. } = correlation;
        let y = correlation.adjoint(x.values(), weight.values(), Some(bias.values()));
        let batch = y.len() / (fine_channels * fine_samples);
        Array::new(y, &[batch, fine_channels, fine_samples])
    }

    fn backward(&self, [x, weight, bias]: &[Array; 3], dy: &Array) -> [Array; 3] {
        let correlation = self.correlation(x, weight);
        let dx = correlation.forward(dy.values(), weight.values(), None);
        let d_weight = correlation.kernel_gradient(dy.values(), x.values());
        let d_bias = channel_sums(dy.values(), bias.width(), dy.width());
        [
            Array::new(dx, x.shape()),
            Array::new(d_weight, weight.shape()),
            Array::new(d_bias, bias.shape()),
        ]
    }
}
