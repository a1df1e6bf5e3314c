use burn::module::Module;
use burn::tensor::Tensor;
use spec::{DiffuserSpec, GROUPS};

use crate::ModelError;
use crate::initialization::InitialWeights;
use crate::sizes::{
    CHANNELS, LARGEST_RATIO, LARGEST_WIDTH, MOST_SAMPLES, MOST_STAGES, divides, multiple, within,
};
use crate::unet::{LevelEmbedding, Modulation, UNet, UNetConfig};

/// The sizes of a Diffuser, checked against each other.
#[derive(Clone, Debug)]
pub(crate) struct DiffuserConfig {
    unet: UNetConfig,
    embedding: usize,
}

impl DiffuserConfig {
    /// `samples` of a whole trajectory.
    pub fn new(spec: &DiffuserSpec, samples: u32) -> Result<Self, ModelError> {
        within("width", spec.width, GROUPS, LARGEST_WIDTH)?;
        multiple("width", spec.width, GROUPS, "the groups of the normalization")?;
        for &multiplier in &spec.multipliers {
            within("multipliers", multiplier, 1, LARGEST_RATIO)?;
        }
        check_stages("multipliers", spec.multipliers.len(), samples)?;
        let width = spec.width as usize;
        Ok(Self {
            unet: UNetConfig {
                channels: 2 * CHANNELS,
                widths: spec.multipliers.iter().map(|&by| width * by as usize).collect(),
                condition: width,
                modulation: Modulation::Shift,
            },
            embedding: width,
        })
    }

    pub fn init(&self, weights: &mut InitialWeights<'_>) -> Diffuser {
        Diffuser {
            embedding: LevelEmbedding::new(self.embedding, weights),
            unet: self.unet.init(weights),
        }
    }

    pub fn parameter_count(&self) -> u64 {
        LevelEmbedding::parameter_count(self.embedding as u64) + self.unet.parameter_count()
    }
}

/// That a U-Net has stages, and that all but the last can halve `samples`.
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

/// Temporal U-Net on u and y of whole trajectories (Janner et al. 2022, *Planning with Diffusion*;
/// the network of its code).
#[derive(Module, Debug)]
pub(crate) struct Diffuser {
    embedding: LevelEmbedding,
    unet: UNet,
}

impl Diffuser {
    /// Noisy u, then y, `[batch, sample, 14]` at each row's noise level to the prediction in the
    /// same shape.
    pub fn forward(&self, noisy: Tensor<3>, levels: &[usize]) -> Tensor<3> {
        let condition = self.embedding.forward(levels, &noisy.device());
        self.unet.forward(noisy.swap_dims(1, 2), &condition, None).swap_dims(1, 2)
    }
}
