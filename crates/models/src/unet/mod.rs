//! The 1-D U-Net that Diffuser and CDCNN share (Ronneberger et al. 2015; in the form of Janner et
//! al. 2022, which Chi et al. 2023 took over).
//!
//! Inside, series are `[batch, channel, sample]`, the layout of convolutions.

mod block;
mod convolution;
mod level_embedding;

use burn::module::Module;
use burn::tensor::Tensor;

use crate::ModelError;
use crate::initialization::InitialWeights;
use crate::sizes::{MOST_SAMPLES, MOST_STAGES, divides, within};
use block::ConvBlock;
pub(crate) use block::{Modulation, ResidualBlock};
use convolution::{Conv1d, ConvTranspose1d};
pub(crate) use level_embedding::{LevelEmbedding, sinusoid};

/// The sizes of a [`UNet`].
#[derive(Clone, Debug)]
pub(crate) struct UNetConfig {
    /// Channels of the noisy series and of the known series beside it.
    pub inputs: usize,
    /// Channels of the answer.
    pub channels: usize,
    /// Channels of each stage. Every stage but the last halves the samples.
    pub widths: Vec<usize>,
    /// Width of the condition of every block.
    pub condition: usize,
    pub modulation: Modulation,
}

impl UNetConfig {
    /// Channels before each stage.
    fn before_stages(&self) -> impl Iterator<Item = usize> {
        std::iter::once(self.inputs).chain(self.widths.iter().copied())
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
            .before_stages()
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
}

/// Checks that a U-Net has stages, and that all stages but the last can halve `samples`.
pub(crate) fn check_stages(
    field: &'static str,
    stages: usize,
    samples: u32,
) -> Result<(), ModelError> {
    if stages == 0 || stages > MOST_STAGES {
        let allowed = format!("1 to {MOST_STAGES} stages");
        return Err(ModelError::Size { field, value: stages as u64, allowed });
    }
    within("samples", samples, 1, MOST_SAMPLES)?;
    divides("the stride of all stages", 1 << (stages - 1), "samples", samples)
}

/// Two blocks. Then the number of samples is halved.
#[derive(Module, Debug)]
struct DownStage {
    first: ResidualBlock,
    second: ResidualBlock,
    /// Kernel 3, stride 2; none in the last stage.
    downsample: Option<Conv1d>,
}

/// Two blocks on the series and the skip connection from the stage down. Then the number of samples
/// is doubled.
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
    /// Maps `x` `[batch, input, sample]` to `[batch, channel, sample]`. Every block has `condition`
    /// `[batch, 1, width]`. `local` `[batch, first width, sample]` is added after the first block.
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
        // The skip connection of the first stage is not used, as in the published networks.
        for (stage, skip) in self.up.iter().zip(skips.into_iter().rev()) {
            x = stage.first.forward(Tensor::cat(vec![x, skip], 1), condition);
            x = stage.upsample.forward(stage.second.forward(x, condition));
        }
        self.output.forward(self.last.forward(x))
    }

    /// The values that a training step keeps of a trajectory of `samples` samples: the input of every
    /// layer. The input of the network comes from `[sample, channel]`.
    pub fn kept(&self, mut samples: usize) -> usize {
        // All blocks keep the same condition.
        let mut kept = self.middle[0].condition_width();
        for (index, stage) in self.down.iter().enumerate() {
            kept += stage.first.kept_of_input(samples, index == 0) + stage.first.kept(samples);
            kept += stage.second.kept_of_input(samples, false) + stage.second.kept(samples);
            if let Some(downsample) = &stage.downsample {
                kept += downsample.channels()[0] * samples;
                samples /= 2;
            }
        }
        for block in &self.middle {
            kept += block.kept_of_input(samples, false) + block.kept(samples);
        }
        for stage in &self.up {
            kept += stage.first.kept_of_input(samples, false) + stage.first.kept(samples);
            kept += stage.second.kept_of_input(samples, false) + stage.second.kept(samples);
            kept += stage.second.channels()[1] * samples;
            samples *= 2;
        }
        // The last convolutions and the norm between them.
        kept + 3 * self.output.channels()[0] * samples
    }
}
