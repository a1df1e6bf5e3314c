//! Linear layers.

use burn::tensor::Tensor;

use super::affine;
use super::factors::Factors;
use super::fused::{Array, FusedOp, apply, operand};
use super::packed::{PackedWeight, Packing};

/// `x Wᵀ + b` for x `[batch, token, input]`, W `[output, input]`, b `[output]`.
pub fn linear(
    x: Tensor<3>,
    weight: Tensor<2>,
    bias: Tensor<1>,
    packed: &PackedWeight,
) -> Tensor<3> {
    let packing = packed.packing(weight.is_autodiff());
    apply(Linear { packing }, [operand(&x), operand(&weight), operand(&bias)])
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
/// Tasks divide the rows of x, dx and dW, so that each sum belongs to one task.
#[derive(Clone, Debug)]
pub(super) struct Linear {
    pub packing: Packing,
}

impl FusedOp<3> for Linear {
    fn forward(&self, [x, weight, bias]: &[Array; 3]) -> Array {
        let output = bias.width();
        let input = x.width();
        let y = if x.values().len() == input && self.packing.factors == Factors::F32 {
            affine::row(x.values(), weight.values(), bias.values())
        } else {
            let weight = self.packing.transposed(&[weight]);
            affine::forward(x.values(), input, &weight, bias.values())
        };
        let mut shape = x.shape().to_vec();
        if let Some(width) = shape.last_mut() {
            *width = output;
        }
        Array::new(y, &shape)
    }

    fn backward(&self, [x, weight, bias]: &[Array; 3], dy: &Array) -> [Array; 3] {
        let (input, output) = (x.width(), bias.width());
        let factors = self.packing.factors;
        let dx = affine::input_gradient(dy.values(), weight.values(), output, factors, |_, _| ());
        let [d_weight, d_bias] =
            affine::parameter_gradients(x.values(), dy.values(), [input, output], factors);
        [
            Array::new(dx, x.shape()),
            Array::new(d_weight, weight.shape()),
            Array::new(d_bias, bias.shape()),
        ]
    }
}
