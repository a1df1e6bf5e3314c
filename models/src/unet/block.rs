use burn::module::{Module, Param};
use burn::tensor::Tensor;

use super::convolution::Conv1d;
use crate::activations::{Activations, mish};
use crate::initialization::InitialWeights;
use crate::layers::Linear;

/// Kernel of the convolutions inside blocks.
const KERNEL: usize = 5;

/// How a condition changes the channels of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Modulation {
    /// The condition is added (Diffuser).
    Shift,
    /// The condition scales the channels and is added (FiLM, Perez et al. 2018).
    ScaleAndShift,
}

impl Modulation {
    const fn numbers_per_channel(self) -> usize {
        match self {
            Self::Shift => 1,
            Self::ScaleAndShift => 2,
        }
    }
}

/// Scale and shift of `torch.nn.GroupNorm`.
#[derive(Module, Debug)]
struct GroupNorm {
    /// `[channel]`, initially 1.
    weight: Param<Tensor<1>>,
    /// `[channel]`, initially 0.
    bias: Param<Tensor<1>>,
}

/// Convolution, group normalization in 8 groups, Mish.
#[derive(Module, Debug)]
pub(crate) struct ConvBlock {
    conv: Conv1d,
    norm: GroupNorm,
}

impl ConvBlock {
    pub fn new(input: usize, output: usize, weights: &mut InitialWeights<'_>) -> Self {
        Self {
            conv: Conv1d::new(input, output, KERNEL, 1, KERNEL / 2, weights),
            norm: GroupNorm {
                weight: weights.constant([output], 1.0),
                bias: weights.constant([output], 0.0),
            },
        }
    }

    /// `[batch, input, sample]` to `[batch, output, sample]`.
    pub fn forward<A: Activations>(&self, x: A) -> A {
        let x = self.conv.forward(x);
        let shape = x.dims();
        A::operation([x], [true], shape, |[x]| {
            let GroupNorm { weight, bias } = &self.norm;
            kernels::group_norm_mish(x, weight.val(), bias.val(), spec::GROUPS as usize)
        })
    }
}

/// Two convolutions with the condition between them. The input is added at the end, through a
/// convolution of kernel 1 where the widths differ.
#[derive(Module, Debug)]
pub(crate) struct ResidualBlock {
    first: ConvBlock,
    second: ConvBlock,
    condition: Linear,
    skip: Option<Conv1d>,
    #[module(skip)]
    modulation: Modulation,
}

impl ResidualBlock {
    /// A block for conditions of width `condition`.
    pub fn new(
        input: usize,
        output: usize,
        condition: usize,
        modulation: Modulation,
        weights: &mut InitialWeights<'_>,
    ) -> Self {
        let numbers = modulation.numbers_per_channel() * output;
        Self {
            first: ConvBlock::new(input, output, weights),
            second: ConvBlock::new(output, output, weights),
            condition: Linear::new(condition, numbers, weights),
            skip: (input != output).then(|| Conv1d::new(input, output, 1, 1, 0, weights)),
            modulation,
        }
    }

    /// Maps `x` `[batch, input, sample]` to `[batch, output, sample]`, with `condition` `[batch, 1,
    /// width]`.
    pub fn forward<A: Activations>(&self, x: A, condition: &A) -> A {
        let hidden = self.first.forward(x.clone());
        let numbers = self.condition.forward(mish(condition.clone())).transposed();
        let hidden = match self.modulation {
            Modulation::Shift => hidden.plus(numbers),
            Modulation::ScaleAndShift => {
                let [scale, shift] = numbers.halves(1);
                hidden.times(scale).plus(shift)
            }
        };
        let hidden = self.second.forward(hidden);
        match &self.skip {
            None => hidden.plus(x),
            Some(skip) => hidden.plus(skip.forward(x)),
        }
    }
}
