//! The fused operations agree with burn's own in value and gradients, at sizes that do and do not
//! divide vectors and tasks.

mod bf16;
mod tanh;
mod unets;

use burn::tensor::{Device, Tensor, TensorData};
use random::{ChaCha12Rng, SeedableRng};

use super::{
    DropoutMask, Factors, Mask, PackedKernel, PackedWeight, attention, conv_transpose1d, conv1d,
    dropout, gelu_linear, gelu_linear_onto, group_norm_mish, instruction_set, layer_norm, linear,
    norm_linear, norm_linear_of_three, self_attention,
};

const TOLERANCE: f64 = 2e-6;

/// Random tensors that record gradients.
pub(super) fn tensors<const N: usize>(shapes: [[usize; 3]; N]) -> [Tensor<3>; N] {
    let mut generator = ChaCha12Rng::seed_from_u64(3);
    let mut unit = || random::unit_f32(&mut generator);
    // Normal numbers by Box and Muller.
    let mut normal =
        || (-2.0 * (1.0 - unit()).ln()).sqrt() * (std::f32::consts::TAU * unit()).cos();
    shapes.map(|shape| {
        let values: Vec<f32> = (0..shape.iter().product()).map(|_| normal()).collect();
        let device = Device::flex().autodiff();
        Tensor::<3>::from_data(TensorData::new(values, shape), &device).require_grad()
    })
}

/// The tensor's values in row-major order.
pub(super) fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.try_into_vec_as().expect("a tensor in memory, of float32, can be read")
}

/// Checks that both functions have the same value, and that a random sum of it has the same
/// gradients.
#[track_caller]
fn check_agreement<const N: usize>(
    shapes: [[usize; 3]; N],
    fused: impl Fn([Tensor<3>; N]) -> Tensor<3>,
    plain: impl Fn([Tensor<3>; N]) -> Tensor<3>,
) {
    let _guard = instruction_set::tests::unchanged();
    compare(shapes, fused, plain);
}

#[track_caller]
fn compare<const N: usize>(
    shapes: [[usize; 3]; N],
    fused: impl Fn([Tensor<3>; N]) -> Tensor<3>,
    plain: impl Fn([Tensor<3>; N]) -> Tensor<3>,
) {
    for (index, difference) in differences(shapes, fused, plain).into_iter().enumerate() {
        assert!(difference < TOLERANCE, "result {index} of {shapes:?}: {difference:e}");
    }
}

/// Relative differences of the values and of each gradient.
#[track_caller]
fn differences<const N: usize>(
    shapes: [[usize; 3]; N],
    fused: impl Fn([Tensor<3>; N]) -> Tensor<3>,
    plain: impl Fn([Tensor<3>; N]) -> Tensor<3>,
) -> Vec<f64> {
    let results = |function: &dyn Fn([Tensor<3>; N]) -> Tensor<3>| {
        let inputs = tensors(shapes);
        let value = function(inputs.clone());
        let [weights] = tensors([value.dims()]);
        let gradients = (value.clone() * weights.inner().autodiff()).sum().backward();
        let mut all = vec![values(value.inner())];
        all.extend(inputs.iter().map(|input| values(input.grad(&gradients).unwrap())));
        all
    };
    let (fused_results, plain_results) = (results(&fused), results(&plain));
    let terms = plain_results[0].len() as f64;
    let relative = |(fused, plain): (&Vec<f32>, &Vec<f32>)| {
        let norm = |values: &mut dyn Iterator<Item = f32>| {
            values.map(|value| f64::from(value).powi(2)).sum::<f64>().sqrt()
        };
        let difference = norm(&mut fused.iter().zip(plain).map(|(a, b)| a - b));
        // A sum of numbers that cancel has the absolute error of a sum that does not cancel.
        let scale = norm(&mut plain.iter().copied()).max(terms.sqrt());
        difference / scale
    };
    let differences = fused_results.iter().zip(&plain_results).map(relative).collect();
    // Without gradients, the values are the same bit for bit.
    let inputs = tensors(shapes);
    let tracked = fused(inputs.clone()).inner();
    let untracked = fused(inputs.map(Tensor::inner));
    assert_eq!(values(tracked), values(untracked));
    differences
}

pub(super) fn flat(tensor: Tensor<3>) -> Tensor<1> {
    let [_, _, width] = tensor.dims();
    tensor.reshape([width])
}

/// The dropout mask of a batch at `place`.
fn dropout_mask(batch: u32, place: u32) -> Option<DropoutMask> {
    Some(DropoutMask::new((0..batch).map(|key| [key; 4]).collect(), place, 0.3))
}

fn matrix(tensor: Tensor<3>) -> Tensor<2> {
    let [_, rows, columns] = tensor.dims();
    tensor.reshape([rows, columns])
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
            |[x, weight, bias]| linear(x, matrix(weight), flat(bias), &PackedWeight::default()),
            |[x, weight, bias]| linear::plain(x, matrix(weight), flat(bias)),
        );
    }
}

#[test]
fn what_is_kept_of_a_weight_is_not_used_for_another() {
    let packed = PackedWeight::default();
    let product = |weight: f64, packed: &PackedWeight| {
        let device = Device::flex();
        let x = Tensor::<3>::ones([1, 9, 20], &device);
        let weight = Tensor::<2>::ones([8, 20], &device) * weight;
        values(linear(x, weight, Tensor::zeros([8], &device), packed))[0]
    };
    // Each weight is freed before the next is made, so that the next may get its memory.
    for weight in [1.0, 2.0, 3.0, 4.0] {
        assert_eq!(f64::from(product(weight, &packed)), 20.0 * weight);
        assert_eq!(f64::from(product(weight, &packed.clone())), 20.0 * weight);
    }
}

#[test]
fn what_is_kept_of_three_weights_is_not_used_for_others() {
    let device = Device::flex();
    let packed = PackedWeight::default();
    let ones = |width: usize| Tensor::<1>::ones([width], &device);
    let weight = |value: f64| Tensor::<2>::ones([8, 20], &device) * value;
    let [first, second, third] = [1.0, 2.0, 3.0].map(weight);
    let sums = |weights: [&Tensor<2>; 3]| {
        let x = Tensor::<3>::ones([1, 9, 20], &device);
        // The norm of a constant is its bias.
        let (norm, biases) = ([ones(20), ones(20)], [ones(8), ones(8), ones(8)]);
        let y = norm_linear_of_three(x, norm, weights.map(Clone::clone), biases, &packed);
        let y = values(y);
        [y[0], y[8], y[16]]
    };
    assert_eq!(sums([&first, &second, &third]), [21.0, 41.0, 61.0]);
    assert_eq!(sums([&third, &second, &first]), [61.0, 41.0, 21.0]);
    assert_eq!(sums([&third, &second, &second]), [61.0, 41.0, 41.0]);
}

/// The shapes of x, of the norm's scale and shift, of the weight and of the bias.
fn shapes_of_norm_linear([batch, tokens, input, output]: [usize; 4]) -> [[usize; 3]; 5] {
    let norm = [1, 1, input];
    [[batch, tokens, input], norm, norm, [1, output, input], [1, 1, output]]
}

#[test]
fn norm_linear_agrees() {
    for sizes in [[1, 1, 8, 1], [3, 5, 7, 9], [4, 40, 140, 96]] {
        check_agreement(
            shapes_of_norm_linear(sizes),
            |[x, scale, shift, weight, bias]| {
                let norm = [flat(scale), flat(shift)];
                norm_linear(x, norm, matrix(weight), flat(bias), &PackedWeight::default())
            },
            |[x, scale, shift, weight, bias]| {
                norm_linear::plain(x, [flat(scale), flat(shift)], matrix(weight), flat(bias))
            },
        );
    }
}

#[test]
fn norm_linear_of_three_agrees() {
    // The third map has another width than the first two.
    for [batch, tokens, input, outputs] in [[1, 1, 8, 1], [3, 5, 7, 9], [4, 40, 140, 96]] {
        let weight = [1, outputs, input];
        let bias = [1, 1, outputs];
        let norm = [1, 1, input];
        check_agreement(
            [
                [batch, tokens, input],
                norm,
                norm,
                weight,
                weight,
                [1, 2, input],
                bias,
                bias,
                [1, 1, 2],
            ],
            |[x, scale, shift, q, k, v, of_q, of_k, of_v]| {
                let (norm, packed) = ([flat(scale), flat(shift)], PackedWeight::default());
                let biases = [flat(of_q), flat(of_k), flat(of_v)];
                norm_linear_of_three(x, norm, [q, k, v].map(matrix), biases, &packed)
            },
            |[x, scale, shift, q, k, v, of_q, of_k, of_v]| {
                let n = layer_norm::plain(x, flat(scale), flat(shift));
                let each = [(q, of_q), (k, of_k), (v, of_v)];
                let each =
                    each.map(|(weight, bias)| linear::plain(n.clone(), matrix(weight), flat(bias)));
                Tensor::cat(each.into(), 2)
            },
        );
    }
}

/// Prefixes that end within a block of tokens, after a block, and after the last token.
const MASKS: [Mask; 7] = [
    Mask::None,
    Mask::Causal { ahead: 0 },
    Mask::Causal { ahead: 1 },
    Mask::Prefix { length: 0 },
    Mask::Prefix { length: 3 },
    Mask::Prefix { length: 64 },
    Mask::Prefix { length: 200 },
];

#[test]
fn self_attention_agrees() {
    for mask in MASKS {
        for [batch, tokens, heads, width] in [[1, 2, 1, 1], [3, 5, 2, 3], [2, 110, 4, 24]] {
            for dropout in [None, dropout_mask(3, 1)] {
                check_agreement(
                    [[batch, tokens, 3 * heads * width]],
                    |[projected]| {
                        self_attention(projected, heads, mask, dropout.clone(), Factors::F32)
                    },
                    |[projected]| {
                        attention::plain_of_itself(projected, heads, mask, dropout.as_ref())
                    },
                );
            }
        }
    }
}

#[test]
fn gelu_linear_agrees() {
    let no_masks = || [None, None];
    for [batch, tokens, input, output] in [[1, 1, 1, 1], [3, 5, 7, 9], [4, 40, 140, 96]] {
        let shapes =
            [[batch, tokens, output], [batch, tokens, input], [1, output, input], [1, 1, output]];
        check_agreement(
            shapes,
            |[residual, x, weight, bias]| {
                let packed = PackedWeight::default();
                gelu_linear_onto(residual, x, matrix(weight), flat(bias), &packed, no_masks())
            },
            |[residual, x, weight, bias]| {
                gelu_linear::plain(residual, x, matrix(weight), flat(bias), &no_masks())
            },
        );
    }
}

#[test]
fn attention_agrees() {
    for mask in MASKS {
        for [batch, tokens, heads, width] in [[1, 2, 1, 1], [3, 5, 2, 3], [2, 40, 4, 24]] {
            check_agreement(
                [[batch, tokens, heads * width]; 3],
                |[query, key, value]| attention(query, key, value, heads, mask, None, Factors::F32),
                |[query, key, value]| attention::plain(query, key, value, heads, mask, None),
            );
        }
    }
    // As many sources as the mask needs, or more.
    for (sources, mask) in [(21, Mask::None), (4, Mask::Causal { ahead: 1 })] {
        check_agreement(
            [[2, 3, 8], [2, sources, 8], [2, sources, 8]],
            |[query, key, value]| attention(query, key, value, 2, mask, None, Factors::F32),
            |[query, key, value]| attention::plain(query, key, value, 2, mask, None),
        );
    }
}

#[test]
fn attention_with_dropout_agrees() {
    for mask in [Mask::None, Mask::Causal { ahead: 1 }] {
        for [batch, tokens, sources, heads, width] in [[1, 2, 2, 1, 1], [3, 110, 90, 2, 8]] {
            check_agreement(
                [
                    [batch, tokens, heads * width],
                    [batch, sources, heads * width],
                    [batch, sources, heads * width],
                ],
                |[q, k, v]| attention(q, k, v, heads, mask, dropout_mask(3, 1), Factors::F32),
                |[q, k, v]| attention::plain(q, k, v, heads, mask, dropout_mask(3, 1).as_ref()),
            );
        }
    }
}

#[test]
fn gelu_linear_with_dropout_agrees() {
    for [batch, tokens, input, output] in [[1, 1, 1, 1], [3, 5, 7, 9], [4, 700, 70, 96]] {
        let masks = || [dropout_mask(4, 0), dropout_mask(4, 1)];
        let shapes =
            [[batch, tokens, output], [batch, tokens, input], [1, output, input], [1, 1, output]];
        check_agreement(
            shapes,
            |[residual, x, weight, bias]| {
                let packed = PackedWeight::default();
                gelu_linear_onto(residual, x, matrix(weight), flat(bias), &packed, masks())
            },
            |[residual, x, weight, bias]| {
                gelu_linear::plain(residual, x, matrix(weight), flat(bias), &masks())
            },
        );
    }
}

#[test]
fn dropout_agrees() {
    for shape in [[1, 1, 1], [3, 5, 7], [2, 300, 96]] {
        check_agreement(
            [shape],
            |[x]| dropout(x, dropout_mask(3, 0)),
            |[x]| dropout::plain(x, dropout_mask(3, 0).as_ref()),
        );
    }
}

/// The tests above run on the best instruction set of this processor.
#[test]
fn operations_agree_on_every_instruction_set() {
    let causal = Mask::Causal { ahead: 1 };
    let no_masks = || [None, None];
    instruction_set::tests::with_each(|_| {
        compare(
            [[2, 61, 48]; 3],
            |[q, k, v]| attention(q, k, v, 2, causal, dropout_mask(2, 0), Factors::F32),
            |[q, k, v]| attention::plain(q, k, v, 2, causal, dropout_mask(2, 0).as_ref()),
        );
        compare(
            [[2, 90, 40], [1, 1, 40], [1, 1, 40], [1, 70, 40], [1, 1, 70]],
            |[x, scale, shift, weight, bias]| {
                let norm = [flat(scale), flat(shift)];
                norm_linear(x, norm, matrix(weight), flat(bias), &PackedWeight::default())
            },
            |[x, scale, shift, weight, bias]| {
                norm_linear::plain(x, [flat(scale), flat(shift)], matrix(weight), flat(bias))
            },
        );
        compare(
            [[2, 90, 30], [2, 90, 50], [1, 30, 50], [1, 1, 30]],
            |[residual, x, weight, bias]| {
                let packed = PackedWeight::default();
                gelu_linear_onto(residual, x, matrix(weight), flat(bias), &packed, no_masks())
            },
            |[residual, x, weight, bias]| {
                gelu_linear::plain(residual, x, matrix(weight), flat(bias), &no_masks())
            },
        );
        compare(
            [[3, 20, 70], [24, 20, 3], [1, 1, 24]],
            |[x, weight, bias]| conv1d(x, weight, flat(bias), 2, 1, &PackedKernel::default()),
            |[x, weight, bias]| conv1d::plain(x, weight, flat(bias), 2, 1),
        );
        compare(
            [[5, 20, 301], [40, 20, 5], [1, 1, 40]],
            |[x, weight, bias]| conv1d(x, weight, flat(bias), 1, 2, &PackedKernel::default()),
            |[x, weight, bias]| conv1d::plain(x, weight, flat(bias), 1, 2),
        );
        compare(
            [[2, 16, 50], [1, 1, 16], [1, 1, 16]],
            |[x, weight, bias]| group_norm_mish(x, flat(weight), flat(bias), 4),
            |[x, weight, bias]| group_norm_mish::plain(x, flat(weight), flat(bias), 4),
        );
    });
}

/// Compares one thread, two, and more than there are trajectories or channels. With 13
/// trajectories, the first convolution uses Winograd's tiles.
#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let _guard = instruction_set::tests::unchanged();
    let results = [1, 2, 7].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut all = Vec::new();
            for batch in [1, 3, 13] {
                let shapes = [[batch, 24, 90], [24, 24, 5], [48, 24, 5], [1, 1, 48], [48, 24, 4]];
                let inputs = tensors(shapes);
                let [x, same, weight, bias, up] = inputs.clone();
                let [_, _, channels] = bias.dims();
                let y = conv1d(
                    x,
                    same,
                    flat(bias.clone()).slice(0..24),
                    1,
                    2,
                    &PackedKernel::default(),
                );
                let y = conv1d(y, weight, flat(bias.clone()), 2, 2, &PackedKernel::default());
                let y = group_norm_mish(y, flat(bias.clone()), flat(bias.clone()), channels / 6);
                let y = conv_transpose1d(y, up, flat(bias.clone()).slice(0..24), 2, 1);
                let gradients = (y.clone() * y.clone()).sum().backward();
                all.push(values(y.inner()));
                all.extend(inputs.iter().map(|x| values(x.grad(&gradients).unwrap())));
            }
            all
        })
    });
    let [one, two, seven] = &results;
    assert!(one == two && one == seven);
}
