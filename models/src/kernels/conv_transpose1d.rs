use burn::tensor::ops::ConvTransposeOptions;
use burn::tensor::{Tensor, module};

/// The adjoint of [`super::conv1d`] with the same stride and padding, as
/// `torch.nn.ConvTranspose1d`: x `[batch, input, sample]` with weight `[input, output, kernel]`
/// and bias `[output]` to `[batch, output, (sample - 1) stride - 2 padding + kernel]`.
pub(crate) fn conv_transpose1d(
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
    let options = ConvTransposeOptions::new([stride], [padding], [0], [1], 1);
    module::conv_transpose1d(x, weight, Some(bias), options)
}
