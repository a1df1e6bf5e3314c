//! Temporal U-Net on u and y of whole trajectories.

use burn::module::Module;
use burn::tensor::Tensor;
use kernels::DropoutKeys;
use spec::{DiffuserSpec, GROUPS, Known};

use crate::ModelError;
use crate::architecture::{Architecture, Extents};
use crate::denoiser::{Denoiser, Network, Task, Torques};
use crate::diffusion::Process;
use crate::frame::KnownInputs;
use crate::initialization::InitialWeights;
use crate::sizes::{LARGEST_RATIO, LARGEST_WIDTH, multiple, within};
use crate::unet::{LevelEmbedding, Modulation, UNet, UNetConfig, check_stages};

impl Architecture for DiffuserSpec {
    type Model = Denoiser<Diffuser>;

    fn init(
        &self,
        extents: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Denoiser<Diffuser>, ModelError> {
        within("width", self.width, GROUPS, LARGEST_WIDTH)?;
        multiple("width", self.width, GROUPS, "the groups of the normalization")?;
        for &multiplier in &self.multipliers {
            within("multipliers", multiplier, 1, LARGEST_RATIO)?;
        }
        check_stages("multipliers", self.multipliers.len(), extents.samples())?;
        let width = self.width as usize;
        let known_inputs = KnownInputs::of(self.residual);
        let beside = known_inputs.channels(extents.joints) - extents.joints;
        let unet = UNetConfig {
            inputs: 2 * extents.joints + beside,
            channels: 2 * extents.joints,
            widths: self.multipliers.iter().map(|&by| width * by as usize).collect(),
            condition: width,
            modulation: Modulation::Shift,
        };
        let embedding = LevelEmbedding::new(width, weights);
        let network = Diffuser { embedding, unet: unet.init(weights), beside };
        let torques = match (self.known, self.weights) {
            (Known::CleanAndMasked, [_, y_weight]) => Torques::Clean { y_weight },
            (Known::JointNoise, weights) => Torques::Noised { weights },
        };
        let task = Task::Denoise(Process::diffusion(&self.diffusion));
        Ok(Denoiser { network, task, torques, known_inputs })
    }
}

/// Temporal U-Net on u and y of whole trajectories (Janner et al. 2022, *Planning with Diffusion*;
/// the network of its code).
#[derive(Module, Debug)]
pub(crate) struct Diffuser {
    embedding: LevelEmbedding,
    unet: UNet,
    /// Known channels beside the torques.
    beside: usize,
}

impl Network for Diffuser {
    /// The noisy series is u, then y, `[batch, sample, 2 · joint]`. So the known series leaves the
    /// torques out.
    fn forward(
        &self,
        noisy: Tensor<3>,
        levels: &[usize],
        known: Tensor<3>,
        _keys: Option<DropoutKeys>,
    ) -> Tensor<3> {
        let condition = self.embedding.forward(levels, &noisy.device());
        let [batch, samples, channels] = known.dims();
        let series = match self.beside {
            0 => noisy,
            beside => {
                let beside = known.slice([0..batch, 0..samples, channels - beside..channels]);
                Tensor::cat(vec![noisy, beside], 2)
            }
        };
        self.unet.forward(series.swap_dims(1, 2), &condition, None).swap_dims(1, 2)
    }

    fn kept(&self, extents: Extents) -> usize {
        self.embedding.kept() + self.unet.kept(extents.samples() as usize)
    }
}
