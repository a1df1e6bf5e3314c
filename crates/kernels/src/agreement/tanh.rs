//! The hyperbolic tangent against that of the standard library.

use burn::tensor::{Device, Tensor};

use super::super::tanh;
use super::{check_agreement, values};

#[test]
fn tanh_agrees() {
    for shape in [[1, 1, 1], [3, 5, 7], [2, 100, 96]] {
        check_agreement([shape], |[x]| tanh(x), |[x]| tanh::plain(x));
    }
}

#[test]
fn tanh_has_its_limits_at_extreme_values() {
    let extreme: [f32; 8] = [-3e38, -100.0, -44.5, -20.0, 20.0, 44.5, 100.0, 3e38];
    let device = Device::flex().autodiff();
    let x = Tensor::<1>::from_floats(extreme, &device).reshape([1, 1, 8]).require_grad();
    let y = tanh(x.clone());
    let slopes = values(x.grad(&y.clone().sum().backward()).unwrap());
    for ((x, y), slope) in extreme.into_iter().zip(values(y.inner())).zip(slopes) {
        assert!((y - x.signum()).abs() < 1e-6, "tanh({x}) = {y}");
        assert!((0.0..1e-15).contains(&slope), "tanh'({x}) = {slope}");
    }
    let not_a_number = Tensor::<1>::from_floats([f32::NAN], &Device::flex()).reshape([1, 1, 1]);
    assert!(values(tanh(not_a_number))[0].is_nan());
}
