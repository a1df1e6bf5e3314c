use burn::tensor::{Tensor, activation};
use rayon::prelude::*;

use super::fused::{Array, FusedOp, apply, operand};
use super::vectorized;

/// Elements of a task: 64 KiB, which stay in the cache between read and write.
const TASK: usize = 16_384;

/// x tanh(ln(1 + eˣ)) (Misra 2019).
pub(crate) fn mish(x: Tensor<3>) -> Tensor<3> {
    apply(Mish, [operand(&x)]).unwrap_or_else(|| plain(x))
}

pub(super) fn plain(x: Tensor<3>) -> Tensor<3> {
    activation::mish(x)
}

/// d/dx = tanh(s) + x (1 - tanh² s) σ(x) with s = ln(1 + eˣ) and the logistic function σ.
#[derive(Clone, Debug)]
struct Mish;

impl FusedOp<1> for Mish {
    fn forward(&self, [x]: &[Array; 1]) -> Array {
        let mut y = vec![0.0; x.values().len()];
        y.par_chunks_mut(TASK)
            .zip(x.values().par_chunks(TASK))
            .for_each(|(y, x)| vectorized::mish(x, y));
        Array::new(y, x.shape())
    }

    fn backward(&self, [x]: &[Array; 1], dy: &Array) -> [Array; 1] {
        let mut dx = vec![0.0; x.values().len()];
        dx.par_chunks_mut(TASK)
            .zip(x.values().par_chunks(TASK))
            .zip(dy.values().par_chunks(TASK))
            .for_each(|((dx, x), dy)| vectorized::mish_gradient(x, dy, dx));
        [Array::new(dx, x.shape())]
    }
}
