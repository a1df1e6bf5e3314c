use burn::tensor::{Tensor, activation};
use rayon::prelude::*;

use super::fused::{Array, FusedOp, apply, operand};
use super::vectorized;

/// Elements of a task: 64 KiB, which stay in the cache between read and write.
const TASK: usize = 16_384;

/// x Φ(x) with the normal distribution's Φ, exact rather than its tanh approximation
/// (Hendrycks and Gimpel 2016).
pub(crate) fn gelu(x: Tensor<3>) -> Tensor<3> {
    apply(Gelu, [operand(&x)]).unwrap_or_else(|| plain(x))
}

pub(super) fn plain(x: Tensor<3>) -> Tensor<3> {
    activation::gelu(x)
}

/// d/dx x Φ(x) = Φ(x) + x φ(x).
#[derive(Clone, Debug)]
struct Gelu;

impl FusedOp<1> for Gelu {
    fn forward(&self, [x]: &[Array; 1]) -> Array {
        let mut y = vec![0.0; x.values().len()];
        y.par_chunks_mut(TASK)
            .zip(x.values().par_chunks(TASK))
            .for_each(|(y, x)| vectorized::gelu(x, y));
        Array::new(y, x.shape())
    }

    fn backward(&self, [x]: &[Array; 1], dy: &Array) -> [Array; 1] {
        let mut dx = vec![0.0; x.values().len()];
        dx.par_chunks_mut(TASK)
            .zip(x.values().par_chunks(TASK))
            .zip(dy.values().par_chunks(TASK))
            .for_each(|((dx, x), dy)| vectorized::gelu_gradient(x, dy, dx));
        [Array::new(dx, x.shape())]
    }
}
