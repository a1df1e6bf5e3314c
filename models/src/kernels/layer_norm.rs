use burn::tensor::{Tensor, module};

/// PyTorch's default, added to the variance.
const EPSILON: f64 = 1e-5;

/// (x - mean) / √(variance + ε) · weight + bias over the last dimension, biased variance.
pub(crate) fn layer_norm(x: Tensor<3>, weight: Tensor<1>, bias: Tensor<1>) -> Tensor<3> {
    module::layer_norm(x, weight, Some(bias), EPSILON)
}
