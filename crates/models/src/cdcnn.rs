//! Conditional U-Net on y. A flow uses the same network.

use burn::module::Module;
use burn::tensor::Tensor;
use kernels::DropoutKeys;
use spec::{CdcnnSpec, Conditioning, GROUPS};

use crate::ModelError;
use crate::architecture::{Architecture, Extents};
use crate::denoiser::{Denoiser, Network, Task, Torques};
use crate::diffusion::Process;
use crate::frame::KnownInputs;
use crate::initialization::InitialWeights;
use crate::sizes::{LARGEST_WIDTH, multiple, within};
use crate::unet::{LevelEmbedding, Modulation, ResidualBlock, UNet, UNetConfig, check_stages};

impl Architecture for CdcnnSpec {
    type Model = Denoiser<Cdcnn>;

    fn init(
        &self,
        extents: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Denoiser<Cdcnn>, ModelError> {
        let known_inputs = KnownInputs::of(self.residual);
        let sizes = CdcnnSizes {
            embedding: self.embedding,
            widths: &self.widths,
            conditioning: self.conditioning,
            known_inputs,
        };
        let network = sizes.init(extents, weights)?;
        let task = Task::Denoise(Process::diffusion(&self.diffusion));
        Ok(Denoiser { network, task, torques: Torques::Apart, known_inputs })
    }
}

/// The sizes of a [`Cdcnn`].
pub(crate) struct CdcnnSizes<'a> {
    pub embedding: u32,
    pub widths: &'a [u32],
    pub conditioning: Conditioning,
    pub known_inputs: KnownInputs,
}

impl CdcnnSizes<'_> {
    pub fn init(
        &self,
        extents: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Cdcnn, ModelError> {
        let Self { embedding, widths, conditioning, known_inputs } = *self;
        let known = known_inputs.channels(extents.joints);
        within("embedding", embedding, 4, LARGEST_WIDTH)?;
        multiple("embedding", embedding, 2, "for sine and cosine")?;
        check_stages("widths", widths.len(), extents.samples())?;
        for &width in widths {
            within("widths", width, GROUPS, LARGEST_WIDTH)?;
            multiple("widths", width, GROUPS, "the groups of the normalization")?;
        }
        let embedding = embedding as usize;
        let condition = match conditioning {
            Conditioning::Local => embedding,
            Conditioning::Global => embedding + extents.samples() as usize * known,
        };
        let modulation = Modulation::ScaleAndShift;
        let widths: Vec<usize> = widths.iter().map(|&width| width as usize).collect();
        let first = widths.first().copied().unwrap_or(extents.joints);
        let channels = extents.joints;
        let unet = UNetConfig { inputs: channels, channels, widths, condition, modulation };
        Ok(Cdcnn {
            embedding: LevelEmbedding::new(embedding, weights),
            unet: unet.init(weights),
            local: match conditioning {
                Conditioning::Local => {
                    Some(ResidualBlock::new(known, first, condition, modulation, weights))
                }
                Conditioning::Global => None,
            },
        })
    }
}

/// Conditional U-Net on y (Chi et al. 2023, *Diffusion Policy*; the network of its code).
///
/// The network [sees](KnownInputs) the known part of each sample. With local conditioning the known
/// part passes a block of its own and is added after the first block of the first stage. It enters
/// additively, and FiLM carries the noise level alone. The code of Chi et al. has a second such
/// block, whose output would be added at the end under a condition that is never true. It has no
/// effect there, so it is left out here.
#[derive(Module, Debug)]
pub(crate) struct Cdcnn {
    embedding: LevelEmbedding,
    unet: UNet,
    /// The block of the known part. Without it, the known part belongs to the condition of every
    /// block.
    local: Option<ResidualBlock>,
}

impl Network for Cdcnn {
    fn forward(
        &self,
        noisy: Tensor<3>,
        levels: &[usize],
        known: Tensor<3>,
        _keys: Option<DropoutKeys>,
    ) -> Tensor<3> {
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

    fn kept(&self, extents: Extents) -> usize {
        let samples = extents.samples() as usize;
        let local = self.local.as_ref();
        let local =
            local.map_or(0, |block| block.kept_of_input(samples, true) + block.kept(samples));
        self.embedding.kept() + local + self.unet.kept(samples)
    }
}
