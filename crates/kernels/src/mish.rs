//! Mish, x tanh(ln(1 + eˣ)).

use burn::tensor::{Tensor, activation};

use super::fused::{Array, FusedOp, apply, operand};
use super::parts::each_part;
use super::vectorized;

/// Elements of a task: 64 KiB, which stay in the cache between reading and writing.
const TASK: usize = 16_384;

/// x tanh(ln(1 + eˣ)) (Misra 2019).
pub fn mish(x: Tensor<3>) -> Tensor<3> {
    apply(Mish, [operand(&x)]).unwrap_or_else(|| plain(x))
}

pub(super) fn plain(x: Tensor<3>) -> Tensor<3> {
    activation::mish(x)
}

/// d/dx = tanh(s) + x (1 - tanh² s) σ(x) with s = ln(1 + eˣ) and the logistic function σ.
#[derive(Clone, Debug)]
pub(super) struct Mish;

impl FusedOp<1> for Mish {
    fn forward(&self, [x]: &[Array; 1]) -> Array {
        let y = each_part(x.values().len(), TASK, |index, y| {
            vectorized::mish(&x.values()[index * TASK..][..y.len()], y);
        });
        Array::new(y, x.shape())
    }

    fn backward(&self, [x]: &[Array; 1], dy: &Array) -> [Array; 1] {
        let dx = each_part(x.values().len(), TASK, |index, dx| {
            let here = index * TASK..index * TASK + dx.len();
            vectorized::mish_gradient(&x.values()[here.clone()], &dy.values()[here], dx);
        });
        [Array::new(dx, x.shape())]
    }
}
