//! The values that pass through a network: numbers, or only the count of them.

use std::cell::Cell;
use std::ops::Range;
use std::rc::Rc;

use burn::module::Param;
use burn::tensor::{Device, Tensor};

/// The series of three dimensions that layers take and give.
///
/// A layer writes its `forward` once, over this trait. With tensors it computes. With [`Counted`]
/// it counts the numbers that a training step keeps of one trajectory for the backward pass, so
/// that the count always matches the layers that run.
pub(crate) trait Activations: Clone {
    fn dims(&self) -> [usize; 3];

    /// The result of `compute` on `inputs`, in the shape `shape`. The backward pass needs the
    /// inputs that are `kept`.
    fn operation<const N: usize>(
        inputs: [Self; N],
        kept: [bool; N],
        shape: [usize; 3],
        compute: impl FnOnce([Tensor<3>; N]) -> Tensor<3>,
    ) -> Self;

    /// The same numbers seen in another shape.
    fn view(self, shape: [usize; 3], see: impl FnOnce(Tensor<3>) -> Tensor<3>) -> Self;

    /// Values that have no gradient, on the device of `self`.
    fn constant(
        &self,
        shape: [usize; 3],
        make: impl FnOnce([usize; 3], &Device) -> Tensor<3>,
    ) -> Self;

    /// Notes that an operation needs a temporary buffer of `numbers` values, whatever the batch
    /// size.
    fn works_with(&self, numbers: usize);

    /// The sum; `other` may have extents of 1.
    fn plus(self, other: Self) -> Self {
        let shape = self.dims();
        Self::operation([self, other], [false; 2], shape, |[x, y]| x + y)
    }

    /// The product; `other` may have extents of 1.
    fn times(self, other: Self) -> Self {
        let shape = self.dims();
        Self::operation([self, other], [true; 2], shape, |[x, y]| x * y)
    }

    /// Adds the learned embedding of each position, `[token, channel]`, to these `[batch, token,
    /// channel]`.
    fn at_positions(self, positions: &Param<Tensor<2>>) -> Self {
        let shape = self.dims();
        let [_, tokens, width] = shape;
        let positions = positions.val().slice([0..tokens, 0..width]);
        Self::operation([self], [false], shape, |[x]| x + positions.unsqueeze())
    }

    /// Concatenates `others` after these along `dimension`.
    fn and(self, others: Self, dimension: usize) -> Self {
        let mut shape = self.dims();
        shape[dimension] += others.dims()[dimension];
        Self::operation([self, others], [false; 2], shape, |parts| {
            Tensor::cat(parts.into(), dimension)
        })
    }

    /// The cumulative sum over the samples of `[batch, sample, channel]`, times `scale`. With a
    /// `scale` of 1 over the root of their number, the sum stays as large as independent samples
    /// are.
    fn running_sum(self, scale: f64) -> Self {
        let shape = self.dims();
        Self::operation([self], [false], shape, |[x]| x.cumsum(1) * scale)
    }

    fn part(self, dimension: usize, range: Range<usize>) -> Self {
        let mut ranges = self.dims().map(|extent| 0..extent);
        ranges[dimension] = range;
        let shape = ranges.each_ref().map(ExactSizeIterator::len);
        Self::operation([self], [false], shape, |[x]| x.slice(ranges))
    }

    fn halves(self, dimension: usize) -> [Self; 2] {
        let mut shape = self.dims();
        shape[dimension] /= 2;
        [0, 1].map(|half| {
            self.clone()
                .view(shape, |x| x.narrow(dimension, half * shape[dimension], shape[dimension]))
        })
    }

    /// `[batch, sample, channel]` to `[batch, channel, sample]` and back.
    fn transposed(self) -> Self {
        let [batch, rows, columns] = self.dims();
        self.view([batch, columns, rows], |x| x.swap_dims(1, 2))
    }

    fn reshaped(self, shape: [usize; 3]) -> Self {
        self.view(shape, |x| x.reshape(shape))
    }
}

impl Activations for Tensor<3> {
    fn dims(&self) -> [usize; 3] {
        Tensor::dims(self)
    }

    fn operation<const N: usize>(
        inputs: [Self; N],
        _kept: [bool; N],
        shape: [usize; 3],
        compute: impl FnOnce([Tensor<3>; N]) -> Tensor<3>,
    ) -> Self {
        let result = compute(inputs);
        assert_eq!(result.dims(), shape, "an operation has the shape that is counted");
        result
    }

    fn view(self, _shape: [usize; 3], see: impl FnOnce(Tensor<3>) -> Tensor<3>) -> Self {
        see(self)
    }

    fn constant(
        &self,
        shape: [usize; 3],
        make: impl FnOnce([usize; 3], &Device) -> Tensor<3>,
    ) -> Self {
        make(shape, &self.device())
    }

    fn works_with(&self, _numbers: usize) {}
}

/// The shapes of activations without their values.
#[derive(Clone, Debug)]
pub(crate) struct Counted {
    shape: [usize; 3],
    array: Rc<Array>,
    /// Whether the memory has another order than the shape. An operation that keeps such
    /// activations makes a copy.
    is_strided: bool,
    tally: Rc<Tally>,
}

/// An array in memory, which several views can share.
#[derive(Debug)]
struct Array {
    numbers: u64,
    kept: Cell<bool>,
}

/// Totals of the numbers that [`Counted`] activations need.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    kept: Cell<u64>,
    worked_with: Cell<u64>,
}

impl Tally {
    /// Numbers in the arrays that the backward pass needs. Each array counts once.
    pub fn kept(&self) -> u64 {
        self.kept.get()
    }

    /// Size of the largest temporary buffer of an operation.
    pub fn worked_with(&self) -> u64 {
        self.worked_with.get()
    }

    /// The input activations of a network.
    pub fn given(self: &Rc<Self>, shape: [usize; 3]) -> Counted {
        let numbers =
            shape.iter().fold(1, |product: u64, &extent| product.saturating_mul(extent as u64));
        let array = Rc::new(Array { numbers, kept: Cell::new(false) });
        Counted { shape, array, is_strided: false, tally: Rc::clone(self) }
    }
}

impl Counted {
    pub fn keep(&self) {
        if self.is_strided || !self.array.kept.replace(true) {
            self.tally.kept.set(self.tally.kept.get().saturating_add(self.array.numbers));
        }
    }
}

impl Activations for Counted {
    fn dims(&self) -> [usize; 3] {
        self.shape
    }

    fn operation<const N: usize>(
        inputs: [Self; N],
        kept: [bool; N],
        shape: [usize; 3],
        _compute: impl FnOnce([Tensor<3>; N]) -> Tensor<3>,
    ) -> Self {
        for (input, _) in inputs.iter().zip(kept).filter(|(_, kept)| *kept) {
            input.keep();
        }
        inputs[0].tally.given(shape)
    }

    fn view(self, shape: [usize; 3], _see: impl FnOnce(Tensor<3>) -> Tensor<3>) -> Self {
        Self { shape, ..self }
    }

    fn transposed(self) -> Self {
        let [batch, rows, columns] = self.shape;
        Self { shape: [batch, columns, rows], is_strided: rows > 1 && columns > 1, ..self }
    }

    fn constant(
        &self,
        shape: [usize; 3],
        _make: impl FnOnce([usize; 3], &Device) -> Tensor<3>,
    ) -> Self {
        self.tally.given(shape)
    }

    fn works_with(&self, numbers: usize) {
        let most = self.tally.worked_with.get().max(numbers as u64);
        self.tally.worked_with.set(most);
    }
}

/// x tanh(ln(1 + eˣ)).
pub(crate) fn mish<A: Activations>(x: A) -> A {
    let shape = x.dims();
    A::operation([x], [true], shape, |[x]| kernels::mish(x))
}
