//! A linear layer of GELU, added to a residual.

use std::f32::consts::FRAC_1_SQRT_2;

use burn::tensor::Tensor;
use rayon::prelude::*;

use super::dropout::{self, DropoutMask};
use super::fused::{Array, FusedOp, apply, operand};
use super::packed::{PackedWeight, Packing};
use super::parts::each_unwritten_part_of_two;
use super::{affine, linear, vectorized};

/// Elements per task: 16 KiB, which stay in the first-level cache between two writes.
const TASK: usize = 4096;

/// `residual` plus [`super::linear`] of GELU of x `[batch, token, input]`, without storing the
/// values between them. `residual` has the shape of the result.
///
/// GELU is x Φ(x) with the normal distribution's Φ, exact rather than its tanh approximation
/// (Hendrycks and Gimpel 2016). Its derivative is Φ(x) + x φ(x). `masks` apply dropout to the
/// output of GELU and to that of the linear map.
pub fn gelu_linear_onto(
    residual: Tensor<3>,
    x: Tensor<3>,
    weight: Tensor<2>,
    bias: Tensor<1>,
    packed: &PackedWeight,
    masks: [Option<DropoutMask>; 2],
) -> Tensor<3> {
    let packing = packed.packing(weight.is_autodiff());
    let operands = [operand(&residual), operand(&x), operand(&weight), operand(&bias)];
    let op = GeluLinear { packing, masks };
    apply(op.clone(), operands).unwrap_or_else(|| plain(residual, x, weight, bias, &op.masks))
}

pub(super) fn plain(
    residual: Tensor<3>,
    x: Tensor<3>,
    weight: Tensor<2>,
    bias: Tensor<1>,
    [between, after]: &[Option<DropoutMask>; 2],
) -> Tensor<3> {
    let between = dropout::plain(gelu(x), between.as_ref());
    residual + dropout::plain(linear::plain(between, weight, bias), after.as_ref())
}

/// burn's GELU is exact. On a backend without a GELU of its own, its derivative is that of the
/// approximation, with an error of 4e-4. This one follows from the error function.
fn gelu(x: Tensor<3>) -> Tensor<3> {
    let twice_below = (x.clone() * FRAC_1_SQRT_2).erf() + 1.0;
    x * twice_below * 0.5
}

/// dW = dyᵀ gelu(x), db = Σ dy, dx = gelu'(x) (dy W). The residual's gradient is dy. The backward
/// pass uses the same masks as the forward pass.
#[derive(Clone, Debug)]
pub(super) struct GeluLinear {
    pub packing: Packing,
    pub masks: [Option<DropoutMask>; 2],
}

impl FusedOp<4> for GeluLinear {
    fn forward(&self, [residual, x, weight, bias]: &[Array; 4]) -> Array {
        let [_, rows, width] = *x.shape() else { unreachable!("of rank 3") };
        let (weight, bias) = (self.packing.transposed(&[weight]), bias.values());
        let [between, after] = &self.masks;
        let gelu = |x: &[f32], g: &mut [f32], first| {
            vectorized::gelu(x, g);
            if let Some(mask) = between {
                mask.apply(g, width, first, rows);
            }
        };
        let y = if let Some(mask) = after {
            let mut y = affine::forward_of(gelu, x.values(), width, &weight, bias);
            mask.apply_to_all(&mut y, residual.width(), rows);
            y.par_chunks_mut(TASK).zip(residual.values().par_chunks(TASK)).for_each(|(y, z)| {
                for (y, z) in y.iter_mut().zip(z) {
                    *y += z;
                }
            });
            y
        } else {
            affine::forward_of_onto(gelu, x.values(), width, &weight, bias, residual.values())
        };
        Array::new(y, residual.shape())
    }

    fn backward(&self, [_, x, weight, bias]: &[Array; 4], dy: &Array) -> [Array; 4] {
        let [_, rows, width] = *x.shape() else { unreachable!("of rank 3") };
        let output = bias.width();
        let [of_gelu, of_output] = &self.masks;
        let d_residual = dy.clone();
        let dy = match of_output {
            None => dy.clone(),
            Some(mask) => {
                let mut masked = dy.values().to_vec();
                mask.apply_to_all(&mut masked, output, rows);
                Array::new(masked, dy.shape())
            }
        };
        // The slope is computed along with the value, because both need the same exponential.
        let x_values = x.values();
        let gelu_and_slope = |first: usize, between: &mut [_], slope: &mut [_]| {
            vectorized::gelu_and_slope(&x_values[first..][..between.len()], between, slope);
        };
        // SAFETY: the function writes as many values as it gets.
        let [mut between, slope] =
            unsafe { each_unwritten_part_of_two(x_values.len(), TASK, gelu_and_slope) };
        if let Some(mask) = of_gelu {
            mask.apply_to_all(&mut between, width, rows);
        }
        let factors = self.packing.factors;
        let [d_weight, d_bias] =
            affine::parameter_gradients(&between, dy.values(), [width, output], factors);
        drop(between);

        let (of_weight, weight) = (weight.shape(), weight.values());
        let dx = affine::input_gradient(dy.values(), weight, output, factors, |dg, first| {
            if let Some(mask) = of_gelu {
                mask.apply(dg, width, first / width, rows);
            }
            vectorized::multiply(dg, &slope[first..first + dg.len()]);
        });
        [
            d_residual,
            Array::new(dx, x.shape()),
            Array::new(d_weight, of_weight),
            Array::new(d_bias, bias.shape()),
        ]
    }
}
