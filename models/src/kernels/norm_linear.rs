use burn::tensor::Tensor;

use super::fused::{Array, FusedOp, apply, operand};
use super::packed::{PackedWeight, Packing};
use super::{affine, layer_norm, linear, vectorized};

/// [`super::linear`] of [`super::layer_norm`] of x `[batch, token, input]`, without keeping what is
/// between them: a row's norm is made again where it is needed.
pub(crate) fn norm_linear(
    x: Tensor<3>,
    norm: [Tensor<1>; 2],
    weight: Tensor<2>,
    bias: Tensor<1>,
    packed: &PackedWeight,
) -> Tensor<3> {
    let packing = packed.packing(weight.is_autodiff());
    let [scale, shift] = &norm;
    let operands = [operand(&x), operand(scale), operand(shift), operand(&weight), operand(&bias)];
    apply(NormLinear { packing }, operands).unwrap_or_else(|| plain(x, norm, weight, bias))
}

pub(super) fn plain(
    x: Tensor<3>,
    [scale, shift]: [Tensor<1>; 2],
    weight: Tensor<2>,
    bias: Tensor<1>,
) -> Tensor<3> {
    linear::plain(layer_norm::plain(x, scale, shift), weight, bias)
}

/// With n = norm(x): dn = dy W, dW = dyᵀ n, db = Σ dy, and of dn what a norm's derivative makes.
#[derive(Clone, Debug)]
struct NormLinear {
    packing: Packing,
}

impl FusedOp<5> for NormLinear {
    fn forward(&self, [x, scale, shift, weight, bias]: &[Array; 5]) -> Array {
        let output = bias.width();
        let norm = |x: &[f32], n: &mut [f32], _| {
            vectorized::layer_norm(x, scale.values(), shift.values(), layer_norm::EPSILON, n);
        };
        let weight = self.packing.transposed(weight);
        let y = affine::forward_of(norm, x.values(), x.width(), &weight, bias.values());
        let mut shape = x.shape().to_vec();
        if let Some(width) = shape.last_mut() {
            *width = output;
        }
        Array::new(y, &shape)
    }

    fn backward(&self, [x, scale, shift, weight, bias]: &[Array; 5], dy: &Array) -> [Array; 5] {
        let norm = [x.clone(), scale.clone(), shift.clone()];
        let n = layer_norm::LayerNorm.forward(&norm);
        let mut d_weight = vec![0.0; weight.values().len()];
        let mut d_bias = vec![0.0; bias.width()];
        affine::parameter_gradients(n.values(), dy.values(), &mut d_weight, &mut d_bias);
        drop(n);
        let dn = affine::input_gradient(dy.values(), weight.values(), bias.width(), |_, _| ());
        let dn = Array::new(dn, x.shape());
        let [dx, d_scale, d_shift] = layer_norm::LayerNorm.backward(&norm, &dn);
        let (d_weight, d_bias) =
            (Array::new(d_weight, weight.shape()), Array::new(d_bias, bias.shape()));
        [dx, d_scale, d_shift, d_weight, d_bias]
    }
}
