use burn::tensor::Tensor;
use rayon::prelude::*;

use super::fused::{Array, FusedOp, apply, operand};
use super::matrix::{Matrix, Output, multiply};
use super::vectorized;

/// `x Wᵀ + b` for x `[batch, token, input]`, W `[output, input]`, b `[output]`.
pub(crate) fn linear(x: Tensor<3>, weight: Tensor<2>, bias: Tensor<1>) -> Tensor<3> {
    apply(Linear, [operand(&x), operand(&weight), operand(&bias)])
        .unwrap_or_else(|| plain(x, weight, bias))
}

pub(super) fn plain(x: Tensor<3>, weight: Tensor<2>, bias: Tensor<1>) -> Tensor<3> {
    let [batch, tokens, input] = x.dims();
    let [output, _] = weight.dims();
    let rows = x.reshape([batch * tokens, input]).matmul(weight.transpose()) + bias.unsqueeze();
    rows.reshape([batch, tokens, output])
}

/// dx = dy W, dW = dyᵀ x, db = Σ dy over the rows.
///
/// Tasks share out the rows of x, dx and dW, so that every sum is one task's.
#[derive(Clone, Debug)]
struct Linear;

impl FusedOp<3> for Linear {
    fn forward(&self, [x, weight, bias]: &[Array; 3]) -> Array {
        let (input, output) = (x.width(), bias.width());
        let rows = x.values().len() / input;
        let task = task_rows(rows);
        let weight = Matrix::new(weight.values(), output, input, input).transposed();
        let mut y = vec![0.0; rows * output];
        y.par_chunks_mut(task * output).zip(x.values().par_chunks(task * input)).for_each(
            |(y, x)| {
                for row in y.chunks_exact_mut(output) {
                    row.copy_from_slice(bias.values());
                }
                let x = Matrix::new(x, x.len() / input, input, input);
                multiply(1.0, x, weight, y, output, Output::Add);
            },
        );
        let mut shape = x.shape().to_vec();
        if let Some(width) = shape.last_mut() {
            *width = output;
        }
        Array::new(y, &shape)
    }

    fn backward(&self, [x, weight, bias]: &[Array; 3], dy: &Array) -> [Array; 3] {
        let (input, output) = (x.width(), bias.width());
        let rows = x.values().len() / input;

        let task = task_rows(rows);
        let mut dx = vec![0.0; rows * input];
        dx.par_chunks_mut(task * input).zip(dy.values().par_chunks(task * output)).for_each(
            |(dx, dy)| {
                let dy = Matrix::new(dy, dy.len() / output, output, output);
                let weight = Matrix::new(weight.values(), output, input, input);
                multiply(1.0, dy, weight, dx, input, Output::Overwrite);
            },
        );

        let task = task_rows(output);
        let mut d_weight = vec![0.0; output * input];
        let mut d_bias = vec![0.0; output];
        d_weight
            .par_chunks_mut(task * input)
            .zip(d_bias.par_chunks_mut(task))
            .enumerate()
            .for_each(|(index, (d_weight, d_bias))| {
                // Columns of dy from this one on.
                let dy = &dy.values()[index * task..];
                let columns = Matrix::new(dy, rows, d_bias.len(), output).transposed();
                let x = Matrix::new(x.values(), rows, input, input);
                multiply(1.0, columns, x, d_weight, input, Output::Overwrite);
                vectorized::add_rows(dy, output, d_bias);
            });
        [
            Array::new(dx, x.shape()),
            Array::new(d_weight, weight.shape()),
            Array::new(d_bias, bias.shape()),
        ]
    }
}

/// One task for every thread: products of large matrices are the fastest.
fn task_rows(rows: usize) -> usize {
    rows.div_ceil(rayon::current_num_threads()).max(1)
}
