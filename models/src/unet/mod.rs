//! The 1-D U-Net that Diffuser and CDCNN share (Ronneberger et al. 2015; in the form of Janner et
//! al. 2022, which Chi et al. 2023 took over).
//!
//! Inside, series are `[batch, channel, sample]`, as convolutions have them.

mod block;
mod convolution;
mod level_embedding;

use burn::module::Module;
use burn::tensor::Tensor;

use crate::initialization::InitialWeights;
use block::ConvBlock;
pub(crate) use block::{Modulation, ResidualBlock};
use convolution::{Conv1d, ConvTranspose1d};
pub(crate) use level_embedding::{LevelEmbedding, sinusoid};

/// The sizes of a [`UNet`].
#[derive(Clone, Debug)]
pub(crate) struct UNetConfig {
    /// Of the series.
    pub channels: usize,
    /// Channels of each stage. Every stage but the last halves the samples.
    pub widths: Vec<usize>,
    /// Width of what every block is conditioned on.
    pub condition: usize,
    pub modulation: Modulation,
}

impl UNetConfig {
    /// Channels before each stage.
    fn inputs(&self) -> impl Iterator<Item = usize> {
        std::iter::once(self.channels).chain(self.widths.iter().copied())
    }

    fn block(
        &self,
        input: usize,
        output: usize,
        weights: &mut InitialWeights<'_>,
    ) -> ResidualBlock {
        ResidualBlock::new(input, output, self.condition, self.modulation, weights)
    }

    pub fn init(&self, weights: &mut InitialWeights<'_>) -> UNet {
        let stages = self.widths.len();
        let down = self
            .inputs()
            .zip(&self.widths)
            .enumerate()
            .map(|(stage, (input, &width))| DownStage {
                first: self.block(input, width, weights),
                second: self.block(width, width, weights),
                downsample: (stage + 1 < stages)
                    .then(|| Conv1d::new(width, width, 3, 2, 1, weights)),
            })
            .collect();
        let deepest = self.widths.last().copied().unwrap_or(self.channels);
        let middle = (0..2).map(|_| self.block(deepest, deepest, weights)).collect();
        let up = self
            .widths
            .windows(2)
            .rev()
            .map(|pair| {
                let (output, input) = (pair[0], pair[1]);
                UpStage {
                    first: self.block(2 * input, output, weights),
                    second: self.block(output, output, weights),
                    upsample: ConvTranspose1d::new(output, output, 4, 2, 1, weights),
                }
            })
            .collect();
        let first = self.widths.first().copied().unwrap_or(self.channels);
        UNet {
            down,
            middle,
            up,
            last: ConvBlock::new(first, first, weights),
            output: Conv1d::new(first, self.channels, 1, 1, 0, weights),
        }
    }

    pub fn parameter_count(&self) -> u64 {
        let stages = self.widths.len();
        let block = |input: usize, output: usize| {
            ResidualBlock::parameter_count(input, output, self.condition, self.modulation)
        };
        let mut count = 0;
        for (stage, (input, &width)) in self.inputs().zip(&self.widths).enumerate() {
            count += block(input, width) + block(width, width);
            if stage + 1 < stages {
                count += Conv1d::parameter_count(width, width, 3);
            }
        }
        for pair in self.widths.windows(2) {
            let (output, input) = (pair[0], pair[1]);
            count += block(2 * input, output) + block(output, output);
            count += ConvTranspose1d::parameter_count(output, output, 4);
        }
        let deepest = self.widths.last().copied().unwrap_or(self.channels);
        let first = self.widths.first().copied().unwrap_or(self.channels);
        count
            + 2 * block(deepest, deepest)
            + ConvBlock::parameter_count(first, first)
            + Conv1d::parameter_count(first, self.channels, 1)
    }
}

/// Two blocks, then half the samples.
#[derive(Module, Debug)]
struct DownStage {
    first: ResidualBlock,
    second: ResidualBlock,
    /// Kernel 3, stride 2; none in the last stage.
    downsample: Option<Conv1d>,
}

/// Two blocks on the series beside that of the stage down, then twice the samples.
#[derive(Module, Debug)]
struct UpStage {
    first: ResidualBlock,
    second: ResidualBlock,
    /// Kernel 4, stride 2.
    upsample: ConvTranspose1d,
}

#[derive(Module, Debug)]
pub(crate) struct UNet {
    down: Vec<DownStage>,
    middle: Vec<ResidualBlock>,
    up: Vec<UpStage>,
    last: ConvBlock,
    output: Conv1d,
}

impl UNet {
    /// x `[batch, channel, sample]` to the same shape, every block conditioned on `condition`
    /// `[batch, 1, width]`; `local` `[batch, first width, sample]` is added after the first block.
    pub fn forward(
        &self,
        mut x: Tensor<3>,
        condition: &Tensor<3>,
        mut local: Option<Tensor<3>>,
    ) -> Tensor<3> {
        let mut skips = Vec::with_capacity(self.down.len());
        for stage in &self.down {
            x = stage.first.forward(x, condition);
            if let Some(local) = local.take() {
                x = x + local;
            }
            x = stage.second.forward(x, condition);
            skips.push(x.clone());
            if let Some(downsample) = &stage.downsample {
                x = downsample.forward(x);
            }
        }
        for block in &self.middle {
            x = block.forward(x, condition);
        }
        // The first stage's series is left over: what it had to say went down with the others.
        for (stage, skip) in self.up.iter().zip(skips.into_iter().rev()) {
            x = stage.first.forward(Tensor::cat(vec![x, skip], 1), condition);
            x = stage.upsample.forward(stage.second.forward(x, condition));
        }
        self.output.forward(self.last.forward(x))
    }
}
