//! Temporal U-Net on u and y of whole trajectories.

use burn::module::Module;
use kernels::DropoutKeys;
use spec::{DiffuserSpec, GROUPS, Known};

use crate::ModelError;
use crate::activations::Activations;
use crate::architecture::{Architecture, Extents};
use crate::denoiser::{Denoiser, Network, Task, Torques};
use crate::diffusion::Process;
use crate::initialization::InitialWeights;
use crate::known_inputs::KnownInputs;
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
    fn forward<A: Activations>(
        &self,
        noisy: A,
        levels: &[usize],
        known: A,
        _keys: Option<DropoutKeys>,
    ) -> A {
        let condition = self.embedding.forward(levels, &noisy);
        let [_, _, channels] = known.dims();
        let series = match self.beside {
            0 => noisy,
            beside => noisy.and(known.part(2, channels - beside..channels), 2),
        };
        self.unet.forward(series.transposed(), &condition, None).transposed()
    }
}
