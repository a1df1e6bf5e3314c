use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::architecture::ArchitectureSpec;
use super::diffusion::{DiffusionSpec, SamplerSpec};
use super::residual::Residual;
use super::sampling::Generation;
use super::sizes::check_unet;
use crate::check::{Check, Violations};

/// U-Net that removes noise from y, given u (Chi et al. 2023; the paper's CDCNN).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CdcnnSpec {
    /// Width of the embedding of the noise level; even. 128 in the paper.
    pub embedding: u32,
    /// Channels of each stage, multiples of 8. Every stage except the last halves the samples.
    pub widths: Vec<u32>,
    /// How u conditions the network.
    #[serde(default)]
    pub conditioning: Conditioning,
    /// How noise is added, and what is predicted from it.
    #[serde(default)]
    pub diffusion: DiffusionSpec,
    /// How predictions are sampled, unless a request names another sampler.
    #[serde(default)]
    pub sampler: SamplerSpec,
    /// The path that predictions are added to.
    #[serde(default, skip_serializing_if = "Residual::is_none")]
    pub residual: Residual,
}

/// How u conditions the network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Conditioning {
    /// Sample by sample, through a block of its own whose output is added to that of the first
    /// block.
    #[default]
    Local,
    /// Flattened, together with the noise level. It scales and shifts the channels of every block
    /// (FiLM).
    Global,
}

impl Check for CdcnnSpec {
    fn check(&self, violations: &mut Violations) {
        check_unet(violations, self.embedding, &self.widths);
    }
}

impl ArchitectureSpec for CdcnnSpec {
    fn halvings(&self) -> usize {
        self.widths.len().saturating_sub(1)
    }

    fn parts(&self) -> &'static [&'static str] {
        &["embedding", "unet", "local"]
    }

    fn residual(&self) -> Residual {
        self.residual
    }

    fn generation(&self) -> Option<Generation<'_>> {
        Some(Generation::Diffusion(&self.diffusion))
    }

    fn sampler(&self) -> Option<&SamplerSpec> {
        Some(&self.sampler)
    }
}
