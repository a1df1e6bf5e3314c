use burn::tensor::{Tensor, module};
use rayon::prelude::*;

use super::fused::{Array, FusedOp, apply, operand};
use super::vectorized;

/// PyTorch's default, added to the variance.
pub(super) const EPSILON: f32 = 1e-5;

/// Rows of a task. Fixed, since the sums over each task's rows are added in turn.
const TASK_ROWS: usize = 128;

/// (x - mean) / √(variance + ε) · weight + bias over the last dimension, biased variance.
pub(crate) fn layer_norm(x: Tensor<3>, weight: Tensor<1>, bias: Tensor<1>) -> Tensor<3> {
    apply(LayerNorm, [operand(&x), operand(&weight), operand(&bias)])
        .unwrap_or_else(|| plain(x, weight, bias))
}

pub(super) fn plain(x: Tensor<3>, weight: Tensor<1>, bias: Tensor<1>) -> Tensor<3> {
    module::layer_norm(x, weight, Some(bias), f64::from(EPSILON))
}

/// The derivative takes the row's mean and deviation anew from x: cheaper than to keep them.
#[derive(Clone, Debug)]
pub(super) struct LayerNorm;

impl FusedOp<3> for LayerNorm {
    fn forward(&self, [x, weight, bias]: &[Array; 3]) -> Array {
        let task = TASK_ROWS * weight.width();
        let mut y = vec![0.0; x.values().len()];
        y.par_chunks_mut(task).zip(x.values().par_chunks(task)).for_each(|(y, x)| {
            vectorized::layer_norm(x, weight.values(), bias.values(), EPSILON, y);
        });
        Array::new(y, x.shape())
    }

    fn backward(&self, [x, weight, bias]: &[Array; 3], dy: &Array) -> [Array; 3] {
        let width = weight.width();
        let task = TASK_ROWS * width;
        let mut dx = vec![0.0; x.values().len()];
        let partial: Vec<(Vec<f32>, Vec<f32>)> = dx
            .par_chunks_mut(task)
            .zip(x.values().par_chunks(task))
            .zip(dy.values().par_chunks(task))
            .map(|((dx, x), dy)| {
                let (mut d_weight, mut d_bias) = (vec![0.0; width], vec![0.0; width]);
                vectorized::layer_norm_gradient(
                    x,
                    weight.values(),
                    EPSILON,
                    dy,
                    dx,
                    &mut d_weight,
                    &mut d_bias,
                );
                (d_weight, d_bias)
            })
            .collect();
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
