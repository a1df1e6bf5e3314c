//! The fused operations agree with burn's own, value and gradients, at sizes that do and do not
//! divide vectors and tasks.

use burn::module::Param;
use burn::tensor::{Device, Tensor};

use super::{Mask, attention, gelu, layer_norm, linear};
use crate::initialization::InitialWeights;
use crate::parameters::host_values;

const TOLERANCE: f64 = 2e-6;

/// Random tensors that record gradients.
fn tensors<const N: usize>(shapes: [[usize; 3]; N]) -> [Tensor<3>; N] {
    let device = Device::flex().autodiff();
    let mut weights = InitialWeights::new(3, &device);
    shapes.map(|shape| {
        let value: Param<Tensor<3>> = weights.normal(shape, 1.0);
        value.val().inner().autodiff().require_grad()
    })
}

/// Both functions have the same value, and of a random sum of it the same gradients.
#[track_caller]
fn check_agreement<const N: usize>(
    shapes: [[usize; 3]; N],
    fused: impl Fn([Tensor<3>; N]) -> Tensor<3>,
    plain: impl Fn([Tensor<3>; N]) -> Tensor<3>,
) {
    let results = |function: &dyn Fn([Tensor<3>; N]) -> Tensor<3>| {
        let inputs = tensors(shapes);
        let value = function(inputs.clone());
        let [weights] = tensors([value.dims()]);
        let gradients = (value.clone() * weights.inner().autodiff()).sum().backward();
        let mut all = vec![host_values(value.inner()).unwrap()];
        all.extend(
            inputs.iter().map(|input| host_values(input.grad(&gradients).unwrap()).unwrap()),
        );
        all
    };
    for (index, (fused, plain)) in results(&fused).iter().zip(&results(&plain)).enumerate() {
        let norm = |values: &mut dyn Iterator<Item = f32>| {
            values.map(|value| f64::from(value).powi(2)).sum::<f64>().sqrt()
        };
        let difference = norm(&mut fused.iter().zip(plain).map(|(a, b)| a - b));
        let relative = difference / norm(&mut plain.iter().copied());
        assert!(relative < TOLERANCE, "result {index} of {shapes:?}: {relative:e}");
    }
    // Without gradients the same values, bit for bit.
    let inputs = tensors(shapes);
    let tracked = fused(inputs.clone()).inner();
    let untracked = fused(inputs.map(Tensor::inner));
    assert_eq!(host_values(tracked).unwrap(), host_values(untracked).unwrap());
}

fn flat(tensor: Tensor<3>) -> Tensor<1> {
    let [_, _, width] = tensor.dims();
    tensor.reshape([width])
}

fn matrix(tensor: Tensor<3>) -> Tensor<2> {
    let [_, rows, columns] = tensor.dims();
    tensor.reshape([rows, columns])
}

#[test]
fn gelu_agrees() {
    for shape in [[1, 1, 1], [3, 5, 7], [2, 100, 96]] {
        check_agreement([shape], |[x]| gelu(x), |[x]| gelu::plain(x));
    }
}

#[test]
fn layer_norm_agrees() {
    for [batch, tokens, width] in [[1, 1, 8], [3, 5, 7], [2, 200, 96]] {
        check_agreement(
            [[batch, tokens, width], [1, 1, width], [1, 1, width]],
            |[x, weight, bias]| layer_norm(x, flat(weight), flat(bias)),
            |[x, weight, bias]| layer_norm::plain(x, flat(weight), flat(bias)),
        );
    }
}

#[test]
fn linear_agrees() {
    for [batch, tokens, input, output] in [[1, 1, 1, 1], [3, 5, 7, 9], [4, 40, 140, 96]] {
        check_agreement(
            [[batch, tokens, input], [1, output, input], [1, 1, output]],
            |[x, weight, bias]| linear(x, matrix(weight), flat(bias)),
            |[x, weight, bias]| linear::plain(x, matrix(weight), flat(bias)),
        );
    }
}

#[test]
fn attention_agrees() {
    for mask in [Mask::None, Mask::Causal { ahead: 0 }, Mask::Causal { ahead: 1 }] {
        for [batch, tokens, heads, width] in [[1, 2, 1, 1], [3, 5, 2, 3], [2, 40, 4, 24]] {
            check_agreement(
                [[batch, tokens, heads * width]; 3],
                |[query, key, value]| attention(query, key, value, heads, mask),
                |[query, key, value]| attention::plain(query, key, value, heads, mask),
            );
        }
    }
    // As many sources as the mask needs, and others.
    for (sources, mask) in [(21, Mask::None), (4, Mask::Causal { ahead: 1 })] {
        check_agreement(
            [[2, 3, 8], [2, sources, 8], [2, sources, 8]],
            |[query, key, value]| attention(query, key, value, 2, mask),
            |[query, key, value]| attention::plain(query, key, value, 2, mask),
        );
    }
}
