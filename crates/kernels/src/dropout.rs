//! Dropout, with masks that are made again for the derivative.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;

use super::fused::{Array, FusedOp, apply, operand};
use super::threefry::{Key, drop_out};

/// The random key of each trajectory.
pub type DropoutKeys = Arc<[Key]>;

/// A dropout mask: it drops values of the series at one place of a network, each with the same
/// probability. The other values are scaled up, so that sums keep their mean (Srivastava et al.
/// 2014).
///
/// The mask is never stored. The backward pass computes it again. The number of (trajectory, row,
/// column) does not depend on the rest of the batch.
#[derive(Clone, Debug)]
pub struct DropoutMask {
    pub(super) keys: DropoutKeys,
    pub(super) place: u32,
    /// 32-bit random numbers below this drop their value.
    pub(super) threshold: u32,
    pub(super) scale: f32,
}

impl DropoutMask {
    /// `rate` is the probability of a drop, from 0 to below 1.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of 2³² becomes the nearest whole number below"
    )]
    pub fn new(keys: DropoutKeys, place: u32, rate: f64) -> Self {
        let threshold = (rate * 4_294_967_296.0) as u32;
        Self { keys, place, threshold, scale: (1.0 / (1.0 - rate)) as f32 }
    }

    /// The probability of a drop.
    #[cfg(feature = "torch")]
    pub(super) fn rate(&self) -> f64 {
        f64::from(self.threshold) / 4_294_967_296.0
    }

    /// A number for generators that know nothing of trajectories.
    #[cfg(feature = "torch")]
    pub(super) fn seed(&self) -> u64 {
        let [first, second, ..] = self.keys.first().copied().unwrap_or_default();
        let seed = u64::from(first) | u64::from(second) << 32;
        // The step of Weyl's sequence that splitmix64 takes.
        seed.wrapping_add(u64::from(self.place).wrapping_mul(0x9e37_79b9_7f4a_7c15))
    }

    /// Applies the mask to `values` in rows of `width`. The first one is row `first` of all rows,
    /// and a trajectory has `rows` rows.
    pub(super) fn apply(&self, values: &mut [f32], width: usize, first: usize, rows: usize) {
        let (mut rest, mut first) = (values, first);
        while !rest.is_empty() {
            let (trajectory, row) = (first / rows, first % rows);
            let count = (rows - row).min(rest.len() / width);
            let (here, after) = rest.split_at_mut(count * width);
            let row = u32::try_from(row).expect("a trajectory's rows are numbered in 32 bits");
            let key = &self.keys[trajectory];
            drop_out(here, width, key, self.place, row, self.threshold, self.scale);
            (rest, first) = (after, first + count);
        }
    }

    /// Applies the mask to all trajectories, on all threads.
    pub(super) fn apply_to_all(&self, values: &mut [f32], width: usize, rows: usize) {
        values.par_chunks_mut(width).with_min_len(TASK.div_ceil(width)).enumerate().for_each(
            |(first, row)| {
                self.apply(row, width, first, rows);
            },
        );
    }

    /// The mask as factors.
    pub(super) fn tensor<const D: usize>(&self, shape: [usize; D], device: &Device) -> Tensor<D> {
        let mut values = vec![1.0; shape.iter().product()];
        let width = shape.last().copied().unwrap_or(1);
        self.apply_to_all(&mut values, width, shape[1..D - 1].iter().product());
        Tensor::from_data(TensorData::new(values, shape), device)
    }
}

/// Elements below which a second thread does not pay.
const TASK: usize = 16_384;

/// Dropout of x `[batch, token, channel]` with `mask`.
pub fn dropout(x: Tensor<3>, mask: Option<DropoutMask>) -> Tensor<3> {
    let Some(mask) = mask else { return x };
    apply(Dropout { mask: mask.clone() }, [operand(&x)]).unwrap_or_else(|| plain(x, Some(&mask)))
}

pub(super) fn plain<const D: usize>(x: Tensor<D>, mask: Option<&DropoutMask>) -> Tensor<D> {
    let Some(mask) = mask else { return x };
    let factors = mask.tensor(x.dims(), &x.device());
    x * factors
}

/// y = M x with dx = M dy.
#[derive(Clone, Debug)]
pub(super) struct Dropout {
    pub mask: DropoutMask,
}

impl Dropout {
    fn applied(&self, x: &Array) -> Array {
        let [.., rows, width] = *x.shape() else { unreachable!("of rank 3") };
        let mut y = x.values().to_vec();
        self.mask.apply_to_all(&mut y, width, rows);
        Array::new(y, x.shape())
    }
}

impl FusedOp<1> for Dropout {
    fn forward(&self, [x]: &[Array; 1]) -> Array {
        self.applied(x)
    }

    fn keep(&self, [_]: [Array; 1]) -> [Array; 1] {
        [Array::new(Vec::new(), &[0])]
    }

    fn backward(&self, [_]: &[Array; 1], dy: &Array) -> [Array; 1] {
        [self.applied(dy)]
    }
}
