//! The backward pass of each operation, fused and plain, agrees with finite differences of its
//! values.

use burn::tensor::Tensor;

use super::agreement::{flat, tensors, values};
use super::{PackedKernel, conv_transpose1d, conv1d, group_norm_mish, mish};

/// Distance between the points of a difference.
const STEP: f64 = 0.02;

/// Largest error of a difference in single precision.
const TOLERANCE: f64 = 5e-4;

/// Compares the directional derivative of a random sum of the value, along a random direction of
/// all inputs, between the gradients and finite differences.
#[track_caller]
fn check_derivative<const N: usize>(
    name: &str,
    shapes: [[usize; 3]; N],
    function: impl Fn([Tensor<3>; N]) -> Tensor<3>,
) {
    let inputs = tensors(shapes);
    let value = function(inputs.clone());
    // Draws the same random numbers without the first few.
    let directions = tensors(shapes.map(|[a, b, c]| [a + 1, b, c]));
    let directions = directions.map(|direction| {
        let [a, b, c] = direction.dims();
        direction.inner().slice([1..a, 0..b, 0..c])
    });
    let [weights] = tensors([value.dims()]);
    let weights = weights.inner();

    let gradients = (value * weights.clone().autodiff()).sum().backward();
    let mut from_gradients = 0.0;
    for (input, direction) in inputs.iter().zip(&directions) {
        let products = input.grad(&gradients).unwrap() * direction.clone();
        from_gradients += total(products);
    }

    let at = |distance: f64| {
        let mut moved = inputs.clone().map(Tensor::inner);
        for (input, direction) in moved.iter_mut().zip(&directions) {
            *input = input.clone() + direction.clone() * distance;
        }
        total(function(moved) * weights.clone())
    };
    // The formula is exact up to the fifth derivative.
    let near = at(STEP) - at(-STEP);
    let far = at(2.0 * STEP) - at(-2.0 * STEP);
    let from_values = (8.0 * near - far) / (12.0 * STEP);
    let difference = (from_gradients - from_values).abs();
    let scale = from_values.abs().max(1.0);
    assert!(
        difference < TOLERANCE * scale,
        "{name} of {shapes:?}: {from_gradients} by its derivative, {from_values} by its values",
    );
}

/// The sum in double precision.
fn total(tensor: Tensor<3>) -> f64 {
    values(tensor).into_iter().map(f64::from).sum()
}

#[test]
fn of_mish() {
    let shapes = [[3, 8, 40]];
    check_derivative("mish", shapes, |[x]| mish(x));
    check_derivative("plain mish", shapes, |[x]| mish::plain(x));
}

#[test]
fn of_group_norm_mish() {
    for groups in [1, 2, 8] {
        let shapes = [[3, 8, 40], [1, 1, 8], [1, 1, 8]];
        check_derivative("fused", shapes, |[x, weight, bias]| {
            group_norm_mish(x, flat(weight), flat(bias), groups)
        });
        check_derivative("plain", shapes, |[x, weight, bias]| {
            group_norm_mish::plain(x, flat(weight), flat(bias), groups)
        });
    }
}

#[test]
fn of_convolutions() {
    for (kernel, stride, padding) in [(5, 1, 2), (3, 2, 1), (1, 1, 0), (4, 3, 0), (2, 3, 3)] {
        let shapes = [[3, 6, 41], [8, 6, kernel], [1, 1, 8]];
        check_derivative("fused", shapes, |[x, weight, bias]| {
            conv1d(x, weight, flat(bias), stride, padding, &PackedKernel::default())
        });
        check_derivative("plain", shapes, |[x, weight, bias]| {
            conv1d::plain(x, weight, flat(bias), stride, padding)
        });
    }
}

#[test]
fn of_convolutions_by_tiles() {
    check_derivative("tiles", [[9, 17, 130], [18, 17, 5], [1, 1, 18]], |[x, weight, bias]| {
        conv1d(x, weight, flat(bias), 1, 2, &PackedKernel::default())
    });
}

#[test]
fn of_transposed_convolutions() {
    for (kernel, stride, padding) in [(4, 2, 1), (5, 1, 2), (2, 3, 0), (7, 3, 2)] {
        let shapes = [[3, 6, 19], [6, 8, kernel], [1, 1, 8]];
        check_derivative("fused", shapes, |[x, weight, bias]| {
            conv_transpose1d(x, weight, flat(bias), stride, padding)
        });
        check_derivative("plain", shapes, |[x, weight, bias]| {
            conv_transpose1d::plain(x, weight, flat(bias), stride, padding)
        });
    }
}
