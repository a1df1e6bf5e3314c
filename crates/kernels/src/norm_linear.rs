//! Linear layers of normed inputs.

use burn::tensor::Tensor;

use super::fused::{Array, FusedOp, apply, operand};
use super::packed::{PackedWeight, Packing, side_by_side};
use super::{affine, layer_norm, linear, vectorized};

/// [`super::linear`] of [`super::layer_norm`] of x `[batch, token, input]`, without storing the
/// normed x. The backward pass computes it again.
pub fn norm_linear(
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

/// Three linear maps of the same normed x in one product. Their outputs lie side by side.
pub fn norm_linear_of_three(
    x: Tensor<3>,
    norm: [Tensor<1>; 2],
    weights: [Tensor<2>; 3],
    biases: [Tensor<1>; 3],
    packed: &PackedWeight,
) -> Tensor<3> {
    let packing = packed.packing(weights[0].is_autodiff());
    let ([scale, shift], [w0, w1, w2], [b0, b1, b2]) = (&norm, &weights, &biases);
    let operands = [
        operand(&x),
        operand(scale),
        operand(shift),
        operand(w0),
        operand(w1),
        operand(w2),
        operand(b0),
        operand(b1),
        operand(b2),
    ];
    apply(NormLinear { packing }, operands).unwrap_or_else(|| {
        plain(x, norm, Tensor::cat(weights.into(), 0), Tensor::cat(biases.into(), 0))
    })
}

pub(super) fn plain(
    x: Tensor<3>,
    [scale, shift]: [Tensor<1>; 2],
    weight: Tensor<2>,
    bias: Tensor<1>,
) -> Tensor<3> {
    linear::plain(layer_norm::plain(x, scale, shift), weight, bias)
}

/// With n = norm(x): dn = dy W, dW = dyᵀ n and db = Σ dy. dx and the norm's gradients follow from
/// dn.
#[derive(Clone, Debug)]
pub(super) struct NormLinear {
    pub packing: Packing,
}

impl NormLinear {
    fn forward_of<const MAPS: usize>(
        &self,
        x: &Array,
        [scale, shift]: [&Array; 2],
        weights: [&Array; MAPS],
        biases: [&Array; MAPS],
    ) -> Array {
        let norm = |x: &[f32], n: &mut [f32], _| {
            vectorized::layer_norm(x, scale.values(), shift.values(), layer_norm::EPSILON, n);
        };
        let weight = self.packing.transposed(&weights);
        let bias = side_by_side(&biases);
        let y = affine::forward_of(norm, x.values(), x.width(), &weight, &bias);
        let mut shape = x.shape().to_vec();
        if let Some(width) = shape.last_mut() {
            *width = bias.len();
        }
        Array::new(y, &shape)
    }

    /// Gradients of x and the norm, of the weights, and of the biases.
    fn backward_of<const MAPS: usize>(
        &self,
        norm: [&Array; 3],
        weights: [&Array; MAPS],
        biases: [&Array; MAPS],
        dy: &Array,
    ) -> ([Array; 3], [Array; MAPS], [Array; MAPS]) {
        let norm = norm.map(Clone::clone);
        let n = layer_norm::LayerNorm.forward(&norm);
        let weight = side_by_side(&weights);
        let output = dy.width();
        let factors = self.packing.factors;
        let extent = [n.width(), output];
        let [d_weight, d_bias] =
            affine::parameter_gradients(n.values(), dy.values(), extent, factors);
        drop(n);
        let dn = affine::input_gradient(dy.values(), &weight, output, factors, |_, _| ());
        let dn = Array::new(dn, norm[0].shape());
        (
            layer_norm::LayerNorm.backward(&norm, &dn),
            parts(d_weight, weights),
            parts(d_bias, biases),
        )
    }
}

/// Splits `values` into consecutive arrays with the shapes of `like`.
fn parts<const N: usize>(mut values: Vec<f32>, like: [&Array; N]) -> [Array; N] {
    like.map(|like| {
        let after = values.split_off(like.values().len());
        let mut part = std::mem::replace(&mut values, after);
        part.shrink_to_fit();
        Array::new(part, like.shape())
    })
}

impl FusedOp<5> for NormLinear {
    fn forward(&self, [x, scale, shift, weight, bias]: &[Array; 5]) -> Array {
        self.forward_of(x, [scale, shift], [weight], [bias])
    }

    fn backward(&self, [x, scale, shift, weight, bias]: &[Array; 5], dy: &Array) -> [Array; 5] {
        let ([dx, d_scale, d_shift], [d_weight], [d_bias]) =
            self.backward_of([x, scale, shift], [weight], [bias], dy);
        [dx, d_scale, d_shift, d_weight, d_bias]
    }
}

impl FusedOp<9> for NormLinear {
    fn forward(&self, [x, scale, shift, w0, w1, w2, b0, b1, b2]: &[Array; 9]) -> Array {
        self.forward_of(x, [scale, shift], [w0, w1, w2], [b0, b1, b2])
    }

    fn backward(
        &self,
        [x, scale, shift, w0, w1, w2, b0, b1, b2]: &[Array; 9],
        dy: &Array,
    ) -> [Array; 9] {
        let ([dx, d_scale, d_shift], [dw0, dw1, dw2], [db0, db1, db2]) =
            self.backward_of([x, scale, shift], [w0, w1, w2], [b0, b1, b2], dy);
        [dx, d_scale, d_shift, dw0, dw1, dw2, db0, db1, db2]
    }
}
