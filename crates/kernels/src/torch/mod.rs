//! Operations with PyTorch's functions, which PyTorch differentiates itself. They run where its libraries open a device: on a
//! GPU of NVIDIA, or on the processor.
//!
//! burn-tch computes the operations of burn one by one, and burn differentiates them one by one. An operation of this crate is
//! a single node of burn's graph instead. Its forward pass records a small graph of PyTorch, whose derivatives are those of
//! `torch.nn`: a layer norm, an attention or a convolution is one kernel there.

#![expect(deprecated, reason = "burn will remove burn-tch in a later release")]

mod bridge;
mod operations;

use std::sync::Arc;

use burn::backend::tensor::FloatTensor;
use burn::tensor::Tensor;
use burn_autodiff::Autodiff;
use burn_autodiff::checkpoint::base::Checkpointer;
use burn_autodiff::checkpoint::strategy::NoCheckpointing;
use burn_autodiff::grads::Gradients;
use burn_autodiff::ops::{Backward, Ops, OpsKind};
use burn_tch::{LibTorch, Storage, TchTensor};

use super::adam_w_step::AdamWStep;
use super::fused::FusedOp;
use super::interruption::leave_if_interrupted;
use super::together::Stepped;
use bridge::Recorded;

pub use bridge::{configure, gpu, peak_bytes, version};

/// A tensor of PyTorch.
pub(super) enum Operand {
    Plain(TchTensor),
    Tracked(FloatTensor<Autodiff<LibTorch>>),
}

/// The tensor, if it is one of PyTorch.
pub(super) fn operand<const D: usize>(tensor: Tensor<D>) -> Option<Operand> {
    if tensor.is_autodiff() {
        tensor.try_into_primitive::<Autodiff<LibTorch>>().ok().map(Operand::Tracked)
    } else {
        tensor.try_into_primitive::<LibTorch>().ok().map(Operand::Plain)
    }
}

/// Computes `op`, and records it for gradients. `None` if only some operands record gradients.
pub(super) fn apply<const N: usize, O: FusedOp<N>>(
    op: &O,
    operands: [Operand; N],
) -> Option<Tensor<3>> {
    let (mut plain, mut tracked) = (Vec::new(), Vec::new());
    for operand in operands {
        match operand {
            Operand::Plain(tensor) => plain.push(tensor),
            Operand::Tracked(tensor) => tracked.push(tensor),
        }
    }
    if let Ok(inputs) = <[TchTensor; N]>::try_from(plain) {
        let output = op.with_torch(inputs.each_ref().map(|input| &input.tensor));
        return Some(Tensor::from_primitive::<LibTorch>(TchTensor::new(output)));
    }
    let tracked: [FloatTensor<Autodiff<LibTorch>>; N] = tracked.try_into().ok()?;
    let nodes = tracked.each_ref().map(|tensor| tensor.node());
    let inputs = tracked.map(|tensor| tensor.into_primitive());
    let leaves = inputs.each_ref().map(|input| input.tensor.detach().set_requires_grad(true));
    let output = op.with_torch(leaves.each_ref());
    let result = TchTensor::new(output.detach());
    let prepared = Derivative::<N>.prepare::<NoCheckpointing>(nodes).compute_bound().stateful();
    Some(Tensor::from_primitive::<Autodiff<LibTorch>>(match prepared {
        OpsKind::UnTracked(prepared) => prepared.finish(result),
        OpsKind::Tracked(prepared) => {
            let recorded = Arc::new(Recorded::new(&output, &leaves));
            let storages = inputs.into_iter().map(|input| input.storage);
            let held = storages.chain([result.storage.clone()]).map(Held).collect();
            prepared.finish(State { recorded, _held: held }, result)
        }
    }))
}

const ONE_DEVICE: &str = "all tensors are on one device";

fn plain(tensor: &Tensor<1>) -> Option<TchTensor> {
    tensor.clone().try_into_primitive::<LibTorch>().ok()
}

/// Whether a tensor without a graph is PyTorch's.
pub(super) fn is_one(tensor: &Tensor<1>) -> bool {
    plain(tensor).is_some()
}

/// [`crate::Together::adam_w`].
pub(super) fn adam_w(parameters: Vec<Stepped>, step: &AdamWStep) -> Vec<[Tensor<1>; 3]> {
    let own = |tensor: Tensor<1>| {
        let tensor = tensor.try_into_primitive::<LibTorch>().expect(ONE_DEVICE);
        if tensor.can_mut() { tensor } else { TchTensor::new(tensor.tensor.copy()) }
    };
    let rows: Vec<[TchTensor; 4]> = parameters
        .into_iter()
        .map(|Stepped { weight, gradient, moments: [first, second] }| {
            let read = |tensor: &Tensor<1>| plain(tensor).expect(ONE_DEVICE);
            [read(&weight), read(&gradient), own(first), own(second)]
        })
        .collect();
    let pointers: Vec<_> =
        rows.iter().map(|row| row.each_ref().map(|tensor| &tensor.tensor)).collect();
    let updated = bridge::adam_w(&pointers, step);
    let made = |tensor| Tensor::from_primitive::<LibTorch>(tensor);
    let results = updated.into_iter().zip(rows);
    results
        .map(|(weight, [_, _, first, second])| [TchTensor::new(weight), first, second].map(made))
        .collect()
}

/// [`crate::Together::norm`].
pub(super) fn norm<'a>(tensors: impl Iterator<Item = &'a Tensor<1>>) -> f64 {
    let tensors: Vec<TchTensor> = tensors.map(|tensor| plain(tensor).expect(ONE_DEVICE)).collect();
    bridge::norm(tensors.iter().map(|tensor| &tensor.tensor))
}

/// The state that the backward pass needs.
#[derive(Clone, Debug)]
struct State {
    recorded: Arc<Recorded>,
    /// PyTorch's graph keeps the values that it needs. That someone holds these counters tells burn not to overwrite them.
    _held: Vec<Held>,
}

/// A counter of the users of a tensor's memory. It does not keep the memory.
#[derive(Clone, Debug)]
struct Held(#[expect(dead_code, reason = "it counts")] Storage);

// SAFETY: the pointer of a counter is compared and never read through.
unsafe impl Send for Held {}
// SAFETY: as above.
unsafe impl Sync for Held {}

#[derive(Debug)]
struct Derivative<const N: usize>;

impl<const N: usize> Backward<LibTorch, N> for Derivative<N> {
    type State = State;

    fn backward(
        self,
        ops: Ops<Self::State, N>,
        gradients: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        leave_if_interrupted();
        let gradient = gradients.consume::<LibTorch>(&ops.node);
        let of_inputs = ops.state.recorded.differentiate(&gradient.tensor);
        for (parent, of_input) in ops.parents.into_iter().zip(of_inputs) {
            if let (Some(parent), Some(of_input)) = (parent, of_input) {
                // The gradient of a summand is the gradient of the sum, in the same memory.
                let of_input = TchTensor::from_existing(of_input, gradient.storage.clone());
                gradients.register::<LibTorch>(parent.id, of_input);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::{Device, Tensor};

    use crate::adam_w_step::AdamWStep;
    use crate::dropout::{DropoutKeys, DropoutMask, dropout};
    use crate::together::{Stepped, Together};

    const SHAPE: [usize; 3] = [4, 100, 250];

    fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
        tensor.try_into_vec_as().unwrap()
    }

    fn mask(key: u32, place: u32) -> DropoutMask {
        let keys: DropoutKeys = Arc::from([[key, 2, 3, 4]; 4]);
        DropoutMask::new(keys, place, 0.25)
    }

    #[test]
    fn dropout_scales_up_what_it_keeps_and_repeats_for_the_same_batch_and_place() {
        let device = Device::libtorch().autodiff();
        let dropped = |key, place| {
            let x = Tensor::<3>::ones(SHAPE, &device).require_grad();
            let y = dropout(x.clone(), Some(mask(key, place)));
            let dx = x.grad(&y.clone().sum().backward()).unwrap();
            (values(y.inner()), values(dx))
        };
        let (y, dx) = dropped(1, 7);
        // The derivative by x = 1 is the factor.
        assert_eq!(y, dx);
        assert!(y.iter().all(|&y| y == 0.0 || (y - 4.0 / 3.0).abs() < 1e-6));
        let zeros = y.iter().filter(|&&y| y == 0.0).count() as f64;
        // Five standard deviations.
        let expected = 0.25 * y.len() as f64;
        assert!((zeros - expected).abs() < 5.0 * (0.75 * expected).sqrt(), "{zeros}");
        assert_eq!(dropped(1, 7).0, y);
        assert_ne!(dropped(1, 8).0, y);
        assert_ne!(dropped(2, 7).0, y);
    }

    #[test]
    fn a_step_and_a_norm_are_those_of_the_processor() {
        let wave = |rate: f32, device: &Device| {
            let values: Vec<f32> = (0..1001).map(|index| (index as f32 * rate).sin()).collect();
            Tensor::<1>::from_floats(values.as_slice(), device)
        };
        let step = AdamWStep {
            time: 3,
            scale: 0.5,
            learning_rate: 1e-2,
            betas: [0.9, 0.95],
            epsilon: 1e-8,
            weight_decay: 0.1,
        };
        let parts = |device: &Device| {
            let moments = [wave(0.3, device) * 0.1, wave(0.2, device).square()];
            Stepped { weight: wave(0.1, device), gradient: wave(0.7, device), moments }
        };
        let (here, there) = (parts(&Device::flex()), parts(&Device::libtorch()));
        assert!(Together::of(&here.gradient).is_none());
        let together = Together::of(&there.gradient).unwrap();
        let norm = together.norm([&there.gradient, &there.weight].into_iter());
        let squares = [&here.gradient, &here.weight].map(crate::sum_of_squares);
        let expected = squares.into_iter().flatten().sum::<f64>().sqrt();
        assert!((norm / expected - 1.0).abs() < 1e-6, "{norm} {expected}");

        let unchanged = there.weight.clone();
        let before = values(unchanged.clone());
        let expected = crate::adam_w(here.weight, here.gradient, here.moments, &step);
        let [found] = <[_; 1]>::try_from(together.adam_w(vec![there], &step)).unwrap();
        for (found, expected) in found.map(values).into_iter().zip(expected.map(values)) {
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-6, "{found} {expected}");
            }
        }
        // Others may still use the old weight.
        assert_eq!(values(unchanged), before);
    }
}
