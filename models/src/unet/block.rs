use burn::module::{Module, Param};
use burn::tensor::Tensor;

use super::convolution::Conv1d;
use crate::initialization::InitialWeights;
use crate::layers::Linear;

/// Of the convolutions inside blocks.
const KERNEL: usize = 5;

/// What a condition does to the channels of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Modulation {
    /// Is added to them (Diffuser).
    Shift,
    /// Scales them, then is added to them (FiLM, Perez et al. 2018).
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
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let GroupNorm { weight, bias } = &self.norm;
        let groups = spec::GROUPS as usize;
        kernels::group_norm_mish(self.conv.forward(x), weight.val(), bias.val(), groups)
    }

    pub const fn parameter_count(input: usize, output: usize) -> u64 {
        Conv1d::parameter_count(input, output, KERNEL) + 2 * output as u64
    }
}

/// Two convolutions, the condition between them, past which the input goes as it is or, where the
/// widths differ, through a convolution of kernel 1.
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
    /// `condition` is its width.
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

    /// x `[batch, input, sample]` with `condition` `[batch, 1, width]` to
    /// `[batch, output, sample]`.
    pub fn forward(&self, x: Tensor<3>, condition: &Tensor<3>) -> Tensor<3> {
        let hidden = self.first.forward(x.clone());
        let numbers = self.condition.forward(kernels::mish(condition.clone())).swap_dims(1, 2);
        let hidden = match self.modulation {
            Modulation::Shift => hidden + numbers,
            Modulation::ScaleAndShift => {
                let halves = numbers.chunk(2, 1);
                let [scale, shift] = <[Tensor<3>; 2]>::try_from(halves)
                    .expect("twice as many numbers as channels are two halves");
                hidden * scale + shift
            }
        };
        let hidden = self.second.forward(hidden);
        match &self.skip {
            None => hidden + x,
            Some(skip) => hidden + skip.forward(x),
        }
    }

    pub const fn parameter_count(
        input: usize,
        output: usize,
        condition: usize,
        modulation: Modulation,
    ) -> u64 {
        let numbers = (modulation.numbers_per_channel() * output) as u64;
        let skip = if input == output { 0 } else { Conv1d::parameter_count(input, output, 1) };
        ConvBlock::parameter_count(input, output)
            + ConvBlock::parameter_count(output, output)
            + Linear::parameter_count(condition as u64, numbers)
            + skip
    }
}
