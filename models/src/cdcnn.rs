use burn::module::Module;
use burn::tensor::Tensor;
use spec::{CdcnnSpec, Conditioning, FlowSpec, GROUPS};

use crate::ModelError;
use crate::diffuser::check_stages;
use crate::initialization::InitialWeights;
use crate::sizes::{CHANNELS, LARGEST_WIDTH, multiple, within};
use crate::unet::{LevelEmbedding, Modulation, ResidualBlock, UNet, UNetConfig};

/// The sizes of a CDCNN, checked against each other.
#[derive(Clone, Debug)]
pub(crate) struct CdcnnConfig {
    unet: UNetConfig,
    embedding: usize,
    conditioning: Conditioning,
    /// Channels of what is known sample by sample.
    known: usize,
}

impl CdcnnConfig {
    /// `samples` of a whole trajectory.
    pub fn new(spec: &CdcnnSpec, samples: u32) -> Result<Self, ModelError> {
        Self::of_sizes(spec.embedding, &spec.widths, spec.conditioning, CHANNELS, samples)
    }

    /// Given u and the integrator's path, sample by sample.
    pub fn of_flow(spec: &FlowSpec, samples: u32) -> Result<Self, ModelError> {
        let conditioning = Conditioning::Local;
        Self::of_sizes(spec.embedding, &spec.widths, conditioning, 2 * CHANNELS, samples)
    }

    fn of_sizes(
        embedding: u32,
        widths: &[u32],
        conditioning: Conditioning,
        known: usize,
        samples: u32,
    ) -> Result<Self, ModelError> {
        within("embedding", embedding, 4, LARGEST_WIDTH)?;
        multiple("embedding", embedding, 2, "for sine and cosine")?;
        check_stages("widths", widths.len(), samples)?;
        for &width in widths {
            within("widths", width, GROUPS, LARGEST_WIDTH)?;
            multiple("widths", width, GROUPS, "the groups of the normalization")?;
        }
        let embedding = embedding as usize;
        let condition = match conditioning {
            Conditioning::Local => embedding,
            Conditioning::Global => embedding + samples as usize * known,
        };
        Ok(Self {
            unet: UNetConfig {
                channels: CHANNELS,
                widths: widths.iter().map(|&width| width as usize).collect(),
                condition,
                modulation: Modulation::ScaleAndShift,
            },
            embedding,
            conditioning,
            known,
        })
    }

    /// Input, output and condition of the block of u, if u has one.
    fn local(&self) -> Option<(usize, usize, usize)> {
        let first = self.unet.widths.first().copied()?;
        match self.conditioning {
            Conditioning::Local => Some((self.known, first, self.unet.condition)),
            Conditioning::Global => None,
        }
    }

    pub fn init(&self, weights: &mut InitialWeights<'_>) -> Cdcnn {
        let modulation = self.unet.modulation;
        Cdcnn {
            embedding: LevelEmbedding::new(self.embedding, weights),
            unet: self.unet.init(weights),
            local: self.local().map(|(input, output, condition)| {
                ResidualBlock::new(input, output, condition, modulation, weights)
            }),
        }
    }

    pub fn parameter_count(&self) -> u64 {
        let local = self.local().map(|(input, output, condition)| {
            ResidualBlock::parameter_count(input, output, condition, self.unet.modulation)
        });
        LevelEmbedding::parameter_count(self.embedding as u64)
            + self.unet.parameter_count()
            + local.unwrap_or(0)
    }
}

/// Conditional U-Net on y (Chi et al. 2023, *Diffusion Policy*; the network of its code), which a flow
/// has too.
///
/// What is known of each sample is u, for a flow the integrator's path beside it. With local conditioning u passes a block of its own and is added after the first block of the
/// first stage, so that it enters additively and FiLM carries the noise level alone. That code has
/// a second block of u whose output a condition that is never true would add at the end; it has
/// no effect there and is not here.
#[derive(Module, Debug)]
pub(crate) struct Cdcnn {
    embedding: LevelEmbedding,
    unet: UNet,
    /// Of u; without it u is part of every block's condition.
    local: Option<ResidualBlock>,
}

impl Cdcnn {
    /// Noisy y `[batch, sample, 7]` at each row's noise level, given what is `known`
    /// `[batch, sample, channel]`, to the prediction in the shape of y.
    pub fn forward(&self, noisy: Tensor<3>, levels: &[usize], known: Tensor<3>) -> Tensor<3> {
        let level = self.embedding.forward(levels, &noisy.device());
        let [batch, samples, channels] = known.dims();
        let (condition, local) = match &self.local {
            Some(block) => {
                let local = block.forward(known.swap_dims(1, 2), &level);
                (level, Some(local))
            }
            None => {
                let known = known.reshape([batch, 1, samples * channels]);
                (Tensor::cat(vec![level, known], 2), None)
            }
        };
        self.unet.forward(noisy.swap_dims(1, 2), &condition, local).swap_dims(1, 2)
    }
}
