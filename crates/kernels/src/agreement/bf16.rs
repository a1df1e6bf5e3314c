//! Products that read bf16 differ from those that read f32 by the rounding of their factors.

use burn::tensor::Tensor;

use super::{
    Factors, Mask, PackedWeight, attention, differences, dropout_mask, flat, gelu_linear,
    gelu_linear_onto, instruction_set, linear, matrix, norm_linear, norm_linear_of_three,
    shapes_of_norm_linear,
};

/// A factor's relative error is at most 2^-9, and about half of that in the mean square. The result
/// has those of two factors, or of four in attention.
const ROUNDING: std::ops::Range<f64> = 3e-5..6e-3;

/// Compares the operation on every instruction set. `exact` are the results that are not computed
/// with products: their values are the same.
#[track_caller]
fn check<const N: usize>(
    shapes: [[usize; 3]; N],
    rounded: impl Fn([Tensor<3>; N]) -> Tensor<3>,
    plain: impl Fn([Tensor<3>; N]) -> Tensor<3>,
    exact: &[usize],
) {
    instruction_set::tests::with_each(|set| {
        for (index, difference) in differences(shapes, &rounded, &plain).into_iter().enumerate() {
            let allowed = if exact.contains(&index) { 0.0..2e-6 } else { ROUNDING };
            assert!(allowed.contains(&difference), "{set}, {index} of {shapes:?}: {difference:e}");
        }
    });
}

fn packed() -> PackedWeight {
    PackedWeight::new(Factors::Bf16)
}

/// Sizes of one row, odd ones, and several tasks.
const SIZES: [[usize; 4]; 4] = [[1, 1, 20, 9], [3, 5, 7, 9], [4, 40, 140, 96], [2, 301, 65, 130]];

#[test]
fn linear_differs_by_rounding() {
    for [batch, tokens, input, output] in SIZES {
        check(
            [[batch, tokens, input], [1, output, input], [1, 1, output]],
            |[x, weight, bias]| linear(x, matrix(weight), flat(bias), &packed()),
            |[x, weight, bias]| linear::plain(x, matrix(weight), flat(bias)),
            &[3],
        );
    }
}

#[test]
fn norm_linear_differs_by_rounding() {
    for sizes in SIZES {
        check(
            shapes_of_norm_linear(sizes),
            |[x, scale, shift, weight, bias]| {
                norm_linear(x, [flat(scale), flat(shift)], matrix(weight), flat(bias), &packed())
            },
            |[x, scale, shift, weight, bias]| {
                norm_linear::plain(x, [flat(scale), flat(shift)], matrix(weight), flat(bias))
            },
            &[5],
        );
    }
}

#[test]
fn norm_linear_of_three_differs_by_rounding() {
    let (norm, weight, bias) = ([1, 1, 40], [1, 24, 40], [1, 1, 24]);
    check(
        [[2, 50, 40], norm, norm, weight, weight, weight, bias, bias, bias],
        |[x, scale, shift, q, k, v, of_q, of_k, of_v]| {
            let biases = [flat(of_q), flat(of_k), flat(of_v)];
            let norm = [flat(scale), flat(shift)];
            norm_linear_of_three(x, norm, [q, k, v].map(matrix), biases, &packed())
        },
        |[x, scale, shift, q, k, v, of_q, of_k, of_v]| {
            let weight = Tensor::cat([q, k, v].map(matrix).into(), 0);
            let bias = Tensor::cat([of_q, of_k, of_v].map(flat).into(), 0);
            norm_linear::plain(x, [flat(scale), flat(shift)], weight, bias)
        },
        &[7, 8, 9],
    );
}

#[test]
fn gelu_linear_differs_by_rounding() {
    let no_masks = || [None, None];
    for [batch, tokens, input, output] in SIZES {
        let shapes =
            [[batch, tokens, output], [batch, tokens, input], [1, output, input], [1, 1, output]];
        check(
            shapes,
            |[residual, x, weight, bias]| {
                gelu_linear_onto(residual, x, matrix(weight), flat(bias), &packed(), no_masks())
            },
            |[residual, x, weight, bias]| {
                gelu_linear::plain(residual, x, matrix(weight), flat(bias), &no_masks())
            },
            &[1, 4],
        );
    }
}

#[test]
fn attention_differs_by_rounding() {
    for mask in [Mask::None, Mask::Causal { ahead: 1 }, Mask::Prefix { length: 3 }] {
        for [batch, tokens, heads, width] in [[1, 7, 2, 4], [3, 5, 2, 3], [2, 110, 4, 24]] {
            for dropout in [None, dropout_mask(3, 1)] {
                check(
                    [[batch, tokens, heads * width]; 3],
                    |[q, k, v]| attention(q, k, v, heads, mask, dropout.clone(), Factors::Bf16),
                    |[q, k, v]| attention::plain(q, k, v, heads, mask, dropout.as_ref()),
                    &[],
                );
            }
        }
    }
}

/// Rows do not depend on those beside them, so a batch does not change a prediction.
#[test]
fn a_row_alone_has_the_same_result() {
    instruction_set::tests::with_each(|set| {
        let [x, weight, bias] = super::tensors([[1, 30, 50], [1, 40, 50], [1, 1, 40]]);
        let [x, weight, bias] = [x, weight, bias].map(Tensor::inner);
        let of =
            |x| super::values(linear(x, matrix(weight.clone()), flat(bias.clone()), &packed()));
        let all = of(x.clone());
        for row in 0..30 {
            assert_eq!(of(x.clone().narrow(1, row, 1)), all[row * 40..][..40], "{set}, {row}");
        }
    });
}
