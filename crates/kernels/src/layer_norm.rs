//! Layer normalization.

use burn::tensor::{Tensor, module};

use super::fused::{Array, FusedOp, apply, operand};
use super::parts::{each_part, in_parts};
use super::vectorized;

/// PyTorch's default, added to the variance.
pub(super) const EPSILON: f32 = 1e-5;

/// Rows of a task. The number is fixed, because the sums of the tasks are added in order.
const TASK_ROWS: usize = 128;

/// (x - mean) / √(variance + ε) · weight + bias over the last dimension, with the biased variance.
pub fn layer_norm(x: Tensor<3>, weight: Tensor<1>, bias: Tensor<1>) -> Tensor<3> {
    apply(LayerNorm, [operand(&x), operand(&weight), operand(&bias)])
        .unwrap_or_else(|| plain(x, weight, bias))
}

pub(super) fn plain(x: Tensor<3>, weight: Tensor<1>, bias: Tensor<1>) -> Tensor<3> {
    module::layer_norm(x, weight, Some(bias), f64::from(EPSILON))
}

/// The backward pass computes the row's mean and deviation again from x, which is cheaper than to
/// store them.
#[derive(Clone, Debug)]
pub(super) struct LayerNorm;

impl FusedOp<3> for LayerNorm {
    fn forward(&self, [x, weight, bias]: &[Array; 3]) -> Array {
        let task = TASK_ROWS * weight.width();
        let y = each_part(x.values().len(), task, |index, y| {
            let x = &x.values()[index * task..][..y.len()];
            vectorized::layer_norm(x, weight.values(), bias.values(), EPSILON, y);
        });
        Array::new(y, x.shape())
    }

    fn backward(&self, [x, weight, bias]: &[Array; 3], dy: &Array) -> [Array; 3] {
        let width = weight.width();
        let task = TASK_ROWS * width;
        let (dx, partial) = in_parts(
            x.values().len(),
            task,
            || (),
            |(), index, dx| {
                let here = index * task..index * task + dx.len();
                let (x, dy) = (&x.values()[here.clone()], &dy.values()[here]);
                let (mut d_weight, mut d_bias) = (vec![0.0; width], vec![0.0; width]);
                let sums = [&mut d_weight[..], &mut d_bias[..]];
                vectorized::layer_norm_gradient(x, weight.values(), EPSILON, dy, dx, sums);
                (d_weight, d_bias)
            },
        );
        let (mut d_weight, mut d_bias) = (vec![0.0; width], vec![0.0; width]);
        for (weight_part, bias_part) in &partial {
            vectorized::add_rows(weight_part, width, &mut d_weight);
            vectorized::add_rows(bias_part, width, &mut d_bias);
        }
        [
            Array::new(dx, x.shape()),
            Array::new(d_weight, weight.shape()),
            Array::new(d_bias, bias.shape()),
        ]
    }
}
