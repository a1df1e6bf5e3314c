use burn::tensor::ops::ConvOptions;
use burn::tensor::{Tensor, module};

/// Cross-correlation along the last dimension, zeros beyond the ends, as `torch.nn.Conv1d`:
/// x `[batch, input, sample]` with weight `[output, input, kernel]` and bias `[output]` to
/// `[batch, output, (sample + 2 padding - kernel) / stride + 1]`.
pub(crate) fn conv1d(
    x: Tensor<3>,
    weight: Tensor<3>,
    bias: Tensor<1>,
    stride: usize,
    padding: usize,
) -> Tensor<3> {
    plain(x, weight, bias, stride, padding)
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
