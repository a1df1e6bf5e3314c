use std::f32::consts::FRAC_1_SQRT_2;

use burn::tensor::Tensor;
use rayon::prelude::*;

use super::fused::{Array, FusedOp, apply, operand};
use super::packed::{PackedWeight, Packing};
use super::{affine, linear, vectorized};

/// Elements of a task: 64 KiB, which stay in the cache between read and write.
const TASK: usize = 16_384;

/// `residual` plus [`super::linear`] of GELU of x `[batch, token, input]`, without keeping what is
/// between them. `residual` has the shape of the result.
///
/// GELU is x Φ(x) with the normal distribution's Φ, exact rather than its tanh approximation
/// (Hendrycks and Gimpel 2016); its derivative is Φ(x) + x φ(x).
pub(crate) fn gelu_linear_onto(
    residual: Tensor<3>,
    x: Tensor<3>,
    weight: Tensor<2>,
    bias: Tensor<1>,
    packed: &PackedWeight,
) -> Tensor<3> {
    let packing = packed.packing(weight.is_autodiff());
    let operands = [operand(&residual), operand(&x), operand(&weight), operand(&bias)];
    apply(GeluLinear { packing }, operands).unwrap_or_else(|| plain(residual, x, weight, bias))
}

pub(super) fn plain(
    residual: Tensor<3>,
    x: Tensor<3>,
    weight: Tensor<2>,
    bias: Tensor<1>,
) -> Tensor<3> {
    residual + linear::plain(gelu(x), weight, bias)
}

/// burn's GELU is the exact one, but where a backend brings none of its own, its derivative is the
/// approximation's, off by 4e-4. This one is derived from the error function.
fn gelu(x: Tensor<3>) -> Tensor<3> {
    let twice_below = (x.clone() * FRAC_1_SQRT_2).erf() + 1.0;
    x * twice_below * 0.5
}

/// dW = dyᵀ gelu(x), db = Σ dy, dx = gelu'(x) (dy W); the residual's gradient is dy.
#[derive(Clone, Debug)]
struct GeluLinear {
    packing: Packing,
}

impl FusedOp<4> for GeluLinear {
    fn forward(&self, [residual, x, weight, bias]: &[Array; 4]) -> Array {
        let mut y = vec![0.0; residual.values().len()];
        affine::forward_of_onto(
            vectorized::gelu,
            x.values(),
            x.width(),
            &self.packing.transposed(weight),
            bias.values(),
            residual.values(),
            &mut y,
        );
        Array::new(y, residual.shape())
    }

    fn backward(&self, [_, x, weight, bias]: &[Array; 4], dy: &Array) -> [Array; 4] {
        let mut d_weight = vec![0.0; weight.values().len()];
        let mut d_bias = vec![0.0; bias.width()];
        let mut between = vec![0.0; x.values().len()];
        between
            .par_chunks_mut(TASK)
            .zip(x.values().par_chunks(TASK))
            .for_each(|(g, x)| vectorized::gelu(x, g));
        affine::parameter_gradients(&between, dy.values(), &mut d_weight, &mut d_bias);

        // In the memory of gelu(x), which is done with.
        let mut dx = between;
        let output = bias.width();
        affine::input_gradient(dy.values(), weight.values(), output, &mut dx, |dg, first| {
            vectorized::times_gelu_slope(&x.values()[first..first + dg.len()], dg);
        });
        [
            dy.clone(),
            Array::new(dx, x.shape()),
            Array::new(d_weight, weight.shape()),
            Array::new(d_bias, bias.shape()),
        ]
    }
}
