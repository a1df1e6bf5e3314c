use burn::tensor::{Tensor, activation};

/// x Φ(x) with the normal distribution's Φ, exact rather than its tanh approximation
/// (Hendrycks and Gimpel 2016).
pub(crate) fn gelu(x: Tensor<3>) -> Tensor<3> {
    activation::gelu(x)
}
