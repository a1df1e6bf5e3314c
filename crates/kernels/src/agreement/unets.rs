//! The operations of U-Nets.

use burn::tensor::{Device, Tensor};
use proptest::prelude::{Just, ProptestConfig, Strategy, proptest};

use super::super::{
    PackedKernel, PerChannel, conv_transpose1d, conv1d, group_norm_mish, mish, norm_conv1d,
};
use super::{check_agreement, flat, tensors, values};

#[test]
fn mish_agrees() {
    for shape in [[1, 1, 1], [3, 5, 7], [2, 100, 96]] {
        check_agreement([shape], |[x]| mish(x), |[x]| mish::plain(x));
    }
}

/// Tests inputs for which a formula with eˣ would overflow, or 1 + eˣ would lose its small part.
#[test]
fn mish_has_its_limits_at_extreme_values() {
    let extreme: [f32; 12] =
        [-3e38, -1e4, -100.0, -87.5, -80.0, 0.0, 19.0, 20.5, 88.9, 100.0, 1e4, 3e38];
    let device = Device::flex().autodiff();
    let x = Tensor::<1>::from_floats(extreme, &device).reshape([1, 1, 12]).require_grad();
    let y = mish(x.clone());
    let slopes = values(x.grad(&y.clone().sum().backward()).unwrap());
    for ((x, y), slope) in extreme.into_iter().zip(values(y.inner())).zip(slopes) {
        let limit = f64::from(x.max(0.0));
        // Below -80, mish deviates from 0 by less than 80 e⁻⁸⁰.
        let far = if x == 0.0 { 0.6 } else { f64::from(u8::from(x > 0.0)) };
        assert!((f64::from(y) - limit).abs() <= 1e-30 + limit * 1e-6, "mish({x}) = {y}");
        assert!((f64::from(slope) - far).abs() < 1e-6, "mish'({x}) = {slope}");
    }
    let not_a_number = Tensor::<1>::from_floats([f32::NAN], &Device::flex()).reshape([1, 1, 1]);
    assert!(values(mish(not_a_number))[0].is_nan());
}

/// Tests a large mean, a small standard deviation and a constant series.
#[test]
fn group_norm_mish_stands_extreme_series() {
    for (scale, offset, tolerance) in [(1e-6, 0.0, 1e-5), (1.0, 100.0, 1e-4), (1e12, 0.0, 1e-5)] {
        let results = [group_norm_mish, group_norm_mish::plain].map(|function| {
            let [x, weight, bias] = tensors([[2, 8, 50], [1, 1, 8], [1, 1, 8]]);
            let value = function(x * scale + offset, flat(weight), flat(bias), 4);
            values(value.inner())
        });
        for (fused, plain) in results[0].iter().zip(&results[1]) {
            assert!((fused - plain).abs() < tolerance, "{scale} {offset}: {fused} {plain}");
        }
    }
    let device = Device::flex();
    let ones = Tensor::<1>::ones([8], &device);
    let constant = Tensor::<3>::ones([1, 8, 30], &device) * 7.0;
    let still = values(group_norm_mish(constant, ones.clone(), ones * 0.0, 8));
    assert!(still.iter().all(|value| value.abs() < 1e-3));
}

/// Sizes of a convolution that has at least one output sample.
fn convolutions() -> impl Strategy<Value = ([usize; 3], [usize; 2], usize, usize)> {
    (1..4_usize, 1..6_usize, 1..6_usize, 1..8_usize, 1..5_usize, 0..5_usize).prop_flat_map(
        |(batch, input, output, kernel, stride, padding)| {
            let fewest = kernel.saturating_sub(2 * padding).max(1);
            let sizes = (Just(batch), Just(input), fewest..fewest + 40);
            (sizes, Just([output, kernel]), Just(stride), Just(padding)).prop_map(
                |((batch, input, samples), others, stride, padding)| {
                    ([batch, input, samples], others, stride, padding)
                },
            )
        },
    )
}

fn check_conv1d(x: [usize; 3], [output, kernel]: [usize; 2], stride: usize, padding: usize) {
    let [_, input, _] = x;
    check_agreement(
        [x, [output, input, kernel], [1, 1, output]],
        |[x, weight, bias]| {
            conv1d(x, weight, flat(bias), stride, padding, &PackedKernel::default())
        },
        |[x, weight, bias]| conv1d::plain(x, weight, flat(bias), stride, padding),
    );
}

fn check_conv_transpose1d(
    x: [usize; 3],
    [output, kernel]: [usize; 2],
    stride: usize,
    padding: usize,
) {
    let [_, input, _] = x;
    check_agreement(
        [x, [input, output, kernel], [1, 1, output]],
        |[x, weight, bias]| conv_transpose1d(x, weight, flat(bias), stride, padding),
        |[x, weight, bias]| conv_transpose1d::plain(x, weight, flat(bias), stride, padding),
    );
}

/// The sizes of the U-Nets, with more windows than a block holds, and with fewer samples than a
/// block sums.
#[test]
fn convolutions_agree_at_the_sizes_of_u_nets() {
    for (x, others, stride, padding) in [
        ([3, 14, 400], [32, 5], 1, 2),
        ([2, 64, 4200], [16, 5], 1, 2),
        ([9, 40, 99], [64, 5], 1, 2),
        ([5, 64, 100], [64, 3], 2, 1),
        // Winograd's tiles: whole ones, cut ones, too few trajectories for a block, and one more
        // than a block.
        ([4, 16, 400], [50, 5], 1, 2),
        ([5, 33, 399], [17, 5], 1, 2),
        ([4, 20, 301], [16, 5], 1, 0),
        ([21, 48, 50], [96, 5], 1, 4),
        ([60, 16, 33], [16, 5], 1, 2),
        // Fewer trajectories than threads, which divide channels.
        ([1, 20, 50], [70, 5], 1, 2),
        ([1, 65, 32], [17, 5], 1, 2),
        ([1, 16, 401], [100, 5], 1, 9),
        // The padding is so large that the first window of the backward pass begins within the
        // series.
        ([21, 18, 50], [20, 5], 1, 7),
        ([1, 64, 100], [7, 1], 1, 0),
    ] {
        check_conv1d(x, others, stride, padding);
    }
    check_conv_transpose1d([3, 64, 50], [64, 4], 2, 1);
    check_conv_transpose1d([1, 32, 200], [48, 4], 2, 1);
}

/// The shapes of x, of the norm's weight and bias, of the scale and the shift, of the kernel and of
/// its bias.
fn shapes_of_norm_conv1d([batch, input, samples]: [usize; 3], output: usize) -> [[usize; 3]; 7] {
    let (norm, each) = ([1, 1, input], [batch, input, 1]);
    [[batch, input, samples], norm, norm, each, each, [output, input, 5], [1, 1, output]]
}

/// Sizes with and without Winograd's tiles, and a single trajectory.
#[test]
fn norm_conv1d_agrees() {
    for (x, output, groups) in
        [([3, 8, 7], 5, 2), ([1, 24, 50], 17, 8), ([5, 32, 99], 48, 8), ([2, 4, 400], 16, 4)]
    {
        let shapes = shapes_of_norm_conv1d(x, output);
        check_agreement(
            shapes,
            |[x, weight, bias, scale, shift, kernel, of_kernel]| {
                let (norm, between) =
                    ([flat(weight), flat(bias)], PerChannel { scale: Some(scale), shift });
                let packed = PackedKernel::default();
                norm_conv1d(x, norm, groups, between, kernel, flat(of_kernel), &packed)
            },
            |[x, weight, bias, scale, shift, kernel, of_kernel]| {
                let (norm, between) =
                    ([flat(weight), flat(bias)], PerChannel { scale: Some(scale), shift });
                norm_conv1d::plain(x, norm, groups, between, kernel, flat(of_kernel))
            },
        );
        let [x, weight, bias, _, shift, kernel, of_kernel] = shapes;
        check_agreement(
            [x, weight, bias, shift, kernel, of_kernel],
            |[x, weight, bias, shift, kernel, of_kernel]| {
                let (norm, between) =
                    ([flat(weight), flat(bias)], PerChannel { scale: None, shift });
                let packed = PackedKernel::default();
                norm_conv1d(x, norm, groups, between, kernel, flat(of_kernel), &packed)
            },
            |[x, weight, bias, shift, kernel, of_kernel]| {
                let (norm, between) =
                    ([flat(weight), flat(bias)], PerChannel { scale: None, shift });
                norm_conv1d::plain(x, norm, groups, between, kernel, flat(of_kernel))
            },
        );
    }
}

#[test]
fn what_is_kept_of_a_kernel_is_not_used_for_another() {
    let (device, packed) = (Device::flex(), PackedKernel::default());
    let sum = |value: f64, packed: &PackedKernel| {
        let x = Tensor::<3>::ones([1, 16, 40], &device);
        let kernel = Tensor::<3>::ones([16, 16, 5], &device) * value;
        values(conv1d(x, kernel, Tensor::zeros([16], &device), 1, 2, packed))[20]
    };
    // Each kernel is freed before the next is made, so that the next may get its memory.
    for value in [1.0, 2.0, 3.0] {
        for packed in [&packed, &packed.clone()] {
            let error = f64::from(sum(value, packed)) - 80.0 * value;
            assert!(error.abs() < 1e-3, "{value}: {error}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn conv1d_agrees((x, others, stride, padding) in convolutions()) {
        check_conv1d(x, others, stride, padding);
    }

    #[test]
    fn conv_transpose1d_agrees(
        batch in 1..4_usize,
        samples in 1..30_usize,
        channels in 1..6_usize,
        others in [1..6_usize, 1..8_usize],
        stride in 1..5_usize,
        padding in 0..4_usize,
    ) {
        let [_, kernel] = others;
        // The padding at both ends leaves at least one sample.
        let padding = padding.min(((samples - 1) * stride + kernel - 1) / 2);
        check_conv_transpose1d([batch, channels, samples], others, stride, padding);
    }

    #[test]
    fn group_norm_mish_agrees(
        batch in 1..4_usize,
        groups in 1..5_usize,
        width in 1..5_usize,
        // Normalizing two values leaves only their signs, and the gradient is only rounding error.
        samples in 4..40_usize,
    ) {
        let channels = groups * width;
        check_agreement(
            [[batch, channels, samples], [1, 1, channels], [1, 1, channels]],
            |[x, weight, bias]| group_norm_mish(x, flat(weight), flat(bias), groups),
            |[x, weight, bias]| group_norm_mish::plain(x, flat(weight), flat(bias), groups),
        );
    }
}
