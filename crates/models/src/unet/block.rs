//! Blocks of a U-Net: two convolutions with a condition between them.

use burn::module::Module;
use burn::tensor::Tensor;
use kernels::mish;

use super::convolution::{Conv1d, GroupNormMish};
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

/// Convolution, group normalization in 8 groups, Mish.
#[derive(Module, Debug)]
pub(crate) struct ConvBlock {
    conv: Conv1d,
    norm: GroupNormMish,
}

impl ConvBlock {
    pub fn new(input: usize, output: usize, weights: &mut InitialWeights<'_>) -> Self {
        Self {
            conv: Conv1d::new(input, output, KERNEL, 1, KERNEL / 2, weights),
            norm: GroupNormMish::new(output, weights),
        }
    }

    /// `[batch, input, sample]` to `[batch, output, sample]`.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        self.norm.forward(self.conv.forward(x))
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
    pub fn forward(&self, x: Tensor<3>, condition: &Tensor<3>) -> Tensor<3> {
        let hidden = self.first.conv.forward(x.clone());
        let numbers = self.condition.forward(mish(condition.clone())).swap_dims(1, 2);
        let (scale, shift) = match self.modulation {
            Modulation::Shift => (None, numbers),
            Modulation::ScaleAndShift => {
                let channels = numbers.dims()[1] / 2;
                let [scale, shift] =
                    [0, channels].map(|first| numbers.clone().narrow(1, first, channels));
                (Some(scale), shift)
            }
        };
        let hidden = self.second.conv.forward_normed(hidden, &self.first.norm, scale, shift);
        let hidden = self.second.norm.forward(hidden);
        match &self.skip {
            None => hidden + x,
            Some(skip) => hidden + skip.forward(x),
        }
    }

    /// The values that a training step keeps of a trajectory of `samples` samples, beside the input
    /// of the block: the condition after Mish and what it maps to, and the input of both norms.
    pub fn kept(&self, samples: usize) -> usize {
        let [_, output] = self.channels();
        self.condition.widths().iter().sum::<usize>() + 2 * output * samples
    }

    /// The channels of input and output.
    pub fn channels(&self) -> [usize; 2] {
        self.first.conv.channels()
    }

    pub fn condition_width(&self) -> usize {
        let [input, _] = self.condition.widths();
        input
    }

    /// The values that a training step keeps of an input of `samples` samples. Each convolution that
    /// reads an input of another layout, `[sample, channel]` in memory, keeps a copy of its own.
    pub fn kept_of_input(&self, samples: usize, is_transposed: bool) -> usize {
        let [input, _] = self.channels();
        let copies = if is_transposed && self.skip.is_some() { 2 } else { 1 };
        copies * input * samples
    }
}
