use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;

use super::fused::{Array, FusedOp, apply, operand};
use super::threefry::{Key, drop_out};

/// What random numbers of each trajectory begin with.
pub type DropoutKeys = Arc<[Key]>;

/// Which numbers of the series at one place of a network are left out, of each as likely; the others
/// are scaled up for it, so that sums stay what they are on average (Srivastava et al. 2014).
///
/// It is never kept: a derivative makes it again. Number (trajectory, row, column) is the same
/// whatever it is computed together with.
#[derive(Clone, Debug)]
pub struct DropoutMask {
    keys: DropoutKeys,
    place: u32,
    /// Random numbers of 32 bits below it leave out.
    threshold: u32,
    scale: f32,
}

impl DropoutMask {
    /// `rate` from 0 to below 1.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of 2³² becomes the nearest whole number below"
    )]
    pub fn new(keys: DropoutKeys, place: u32, rate: f64) -> Self {
        let threshold = (rate * 4_294_967_296.0) as u32;
        Self { keys, place, threshold, scale: (1.0 / (1.0 - rate)) as f32 }
    }

    /// Of `values` in rows of `width`, which follow upon the first `first` ones of all; a trajectory
    /// has `rows`.
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

    /// The same of all trajectories, on all threads.
    pub(super) fn apply_to_all(&self, values: &mut [f32], width: usize, rows: usize) {
        values.par_chunks_mut(width).with_min_len(TASK.div_ceil(width)).enumerate().for_each(
            |(first, row)| {
                self.apply(row, width, first, rows);
            },
        );
    }

    /// What it multiplies numbers with.
    pub(super) fn tensor<const D: usize>(&self, shape: [usize; D], device: &Device) -> Tensor<D> {
        let mut values = vec![1.0; shape.iter().product()];
        let width = shape.last().copied().unwrap_or(1);
        self.apply_to_all(&mut values, width, shape[1..D - 1].iter().product());
        Tensor::from_data(TensorData::new(values, shape), device)
    }
}

/// Elements below which another thread is not worth waking.
const TASK: usize = 16_384;

/// x `[batch, token, channel]` without what `mask` leaves out.
pub fn dropout(x: Tensor<3>, mask: Option<DropoutMask>) -> Tensor<3> {
    let Some(mask) = mask else { return x };
    apply(Dropout { mask: mask.clone() }, [operand(&x)]).unwrap_or_else(|| plain(x, Some(&mask)))
}

pub(super) fn plain<const D: usize>(x: Tensor<D>, mask: Option<&DropoutMask>) -> Tensor<D> {
    let Some(mask) = mask else { return x };
    let factors = mask.tensor(x.dims(), &x.device());
    x * factors
}

/// dx = M dy of y = M x.
#[derive(Clone, Debug)]
struct Dropout {
    mask: DropoutMask,
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
