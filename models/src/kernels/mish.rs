use burn::tensor::{Tensor, activation};

/// x tanh(ln(1 + eˣ)) (Misra 2019).
pub(crate) fn mish(x: Tensor<3>) -> Tensor<3> {
    plain(x)
}

pub(super) fn plain(x: Tensor<3>) -> Tensor<3> {
    activation::mish(x)
}
