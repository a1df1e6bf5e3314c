//! The crate's own operations in burn's autodiff graph, on burn's CPU backend.

use std::fmt::Debug;

use burn::backend::tensor::FloatTensor;
use burn::tensor::{DType, Tensor, TensorData};
use burn_autodiff::Autodiff;
use burn_autodiff::checkpoint::base::Checkpointer;
use burn_autodiff::checkpoint::strategy::NoCheckpointing;
use burn_autodiff::grads::Gradients;
use burn_autodiff::ops::{Backward, Ops, OpsKind};
use burn_flex::{Flex, FlexTensor};

use crate::interruption::leave_if_interrupted;
#[cfg(feature = "torch")]
use crate::torch;

/// An operation on `N` tensors and its backward pass.
pub(super) trait FusedOp<const N: usize>:
    WithTorch<N> + Clone + Debug + Send + 'static
{
    fn forward(&self, inputs: &[Array; N]) -> Array;

    /// The inputs that are kept for the backward pass. Others may be replaced by empty arrays.
    fn keep(&self, inputs: [Array; N]) -> [Array; N] {
        inputs
    }

    /// The gradient of each input, from that of the output.
    fn backward(&self, inputs: &[Array; N], gradient: &Array) -> [Array; N];
}

/// The form of an operation that PyTorch computes and differentiates.
#[cfg(feature = "torch")]
pub(super) trait WithTorch<const N: usize> {
    fn with_torch(&self, inputs: [&tch::Tensor; N]) -> tch::Tensor;
}

/// Without PyTorch's libraries an operation needs no form of theirs.
#[cfg(not(feature = "torch"))]
pub(super) trait WithTorch<const N: usize> {}

#[cfg(not(feature = "torch"))]
impl<T, const N: usize> WithTorch<N> for T {}

/// A contiguous float tensor in memory. Clones share it.
#[derive(Clone, Debug)]
pub(super) struct Array(FlexTensor);

impl Array {
    /// A tensor of `values` in row-major order.
    pub fn new(values: Vec<f32>, shape: &[usize]) -> Self {
        Self(FlexTensor::from_data(TensorData::new(values, shape.to_vec())))
    }

    /// The array of a tensor, which is copied if it is not contiguous.
    pub fn of(tensor: &FlexTensor) -> Self {
        Self(tensor.to_contiguous())
    }

    pub fn values(&self) -> &[f32] {
        self.0.as_slice().expect("operands are contiguous and of type f32")
    }

    pub fn shape(&self) -> &[usize] {
        self.0.layout().shape().as_slice()
    }

    /// Extent of the last dimension.
    pub fn width(&self) -> usize {
        self.shape().last().copied().unwrap_or(1)
    }
}

/// A tensor of a backend with fused operations.
pub(super) enum Operand {
    Plain(FlexTensor),
    Tracked(FloatTensor<Autodiff<Flex>>),
    #[cfg(feature = "torch")]
    Torch(torch::Operand),
}

/// The tensor, if it is a float32 tensor of such a backend.
pub(super) fn operand<const D: usize>(tensor: &Tensor<D>) -> Option<Operand> {
    if tensor.dtype() != DType::F32 {
        return None;
    }
    #[cfg(feature = "torch")]
    if let Some(operand) = torch::operand(tensor.clone()) {
        return Some(Operand::Torch(operand));
    }
    let tensor = tensor.clone();
    if tensor.is_autodiff() {
        tensor.try_into_primitive::<Autodiff<Flex>>().ok().map(Operand::Tracked)
    } else {
        tensor.try_into_primitive::<Flex>().ok().map(Operand::Plain)
    }
}

/// Computes `op` and records it for gradients. `None` if an operand is on another backend, or
/// if only some operands record gradients. The caller then uses burn's own operations.
pub(super) fn apply<const N: usize, O: FusedOp<N>>(
    op: O,
    operands: [Option<Operand>; N],
) -> Option<Tensor<3>> {
    leave_if_interrupted();
    let operands = all(operands)?;
    #[cfg(feature = "torch")]
    if operands.iter().all(|operand| matches!(operand, Operand::Torch(_))) {
        let operands = operands.map(|operand| match operand {
            Operand::Torch(operand) => Some(operand),
            _ => None,
        });
        return torch::apply(&op, all(operands)?);
    }
    if operands.iter().all(|operand| matches!(operand, Operand::Plain(_))) {
        let inputs = all(operands.map(|operand| match operand {
            Operand::Plain(tensor) => Some(Array(tensor.to_contiguous())),
            _ => None,
        }))?;
        return Some(Tensor::from_primitive::<Flex>(op.forward(&inputs).0));
    }
    let tracked = all(operands.map(|operand| match operand {
        Operand::Tracked(tensor) => Some(tensor),
        _ => None,
    }))?;
    let nodes = tracked.each_ref().map(|tensor| tensor.node());
    let inputs = tracked.map(|tensor| Array(tensor.into_primitive().to_contiguous()));
    let output = op.forward(&inputs).0;
    let inputs = op.keep(inputs);
    let prepared = Derivative(op).prepare::<NoCheckpointing>(nodes).compute_bound().stateful();
    Some(Tensor::from_primitive::<Autodiff<Flex>>(match prepared {
        OpsKind::Tracked(prepared) => prepared.finish(inputs, output),
        OpsKind::UnTracked(prepared) => prepared.finish(output),
    }))
}

fn all<T, const N: usize>(items: [Option<T>; N]) -> Option<[T; N]> {
    let items: Vec<T> = items.into_iter().collect::<Option<_>>()?;
    items.try_into().ok()
}

#[derive(Debug)]
struct Derivative<O>(O);

impl<const N: usize, O: FusedOp<N>> Backward<Flex, N> for Derivative<O> {
    type State = [Array; N];

    fn backward(
        self,
        ops: Ops<Self::State, N>,
        gradients: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        leave_if_interrupted();
        let gradient = Array(gradients.consume::<Flex>(&ops.node).to_contiguous());
        let of_inputs = self.0.backward(&ops.state, &gradient);
        for (parent, gradient) in ops.parents.into_iter().zip(of_inputs) {
            if let Some(parent) = parent {
                gradients.register::<Flex>(parent.id, gradient.0);
            }
        }
    }
}
