//! The hyperbolic tangent.

use burn::tensor::Tensor;

use super::fused::{Array, FusedOp, apply, operand};
use super::parts::in_parts;
use super::vectorized;

/// Elements of a task: 64 KiB, which stay in the cache between reading and writing.
const TASK: usize = 16_384;

/// tanh x with an error of about 10⁻⁷.
pub fn tanh(x: Tensor<3>) -> Tensor<3> {
    apply(Tanh, [operand(&x)]).unwrap_or_else(|| plain(x))
}

pub(super) fn plain(x: Tensor<3>) -> Tensor<3> {
    x.tanh()
}

/// d/dx = 1 - tanh² x.
#[derive(Clone, Debug)]
pub(super) struct Tanh;

impl FusedOp<1> for Tanh {
    fn forward(&self, [x]: &[Array; 1]) -> Array {
        let (y, _) = in_parts(
            x.values().len(),
            TASK,
            || (),
            |(), index, y| {
                vectorized::tanh(&x.values()[index * TASK..][..y.len()], y);
            },
        );
        Array::new(y, x.shape())
    }

    fn backward(&self, [x]: &[Array; 1], dy: &Array) -> [Array; 1] {
        let (dx, _) = in_parts(
            x.values().len(),
            TASK,
            || (),
            |(), index, dx| {
                let here = index * TASK..index * TASK + dx.len();
                vectorized::tanh_gradient(&x.values()[here.clone()], &dy.values()[here], dx);
            },
        );
        [Array::new(dx, x.shape())]
    }
}
