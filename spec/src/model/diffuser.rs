use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::architecture::ArchitectureSpec;
use super::diffusion::{DiffusionSpec, SamplerSpec};
use super::residual::Residual;
use super::sampling::Generation;
use super::sizes::check_width;
use crate::check::{Check, Report};

/// Temporal U-Net that removes noise from u and y of a whole trajectory at once, everything known
/// painted over its answer at every step (Janner et al. 2022).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DiffuserSpec {
    /// Channels of the first stage; a multiple of 8. 128 in the paper.
    pub width: u32,
    /// Channels of each stage as multiples of `width`. Every stage but the last halves the samples.
    pub multipliers: Vec<u32>,
    #[serde(default)]
    pub known: Known,
    /// Weights of the squared errors of u and of y, the paper's W. With `clean-and-masked` only y
    /// has errors and the second is a mere scale.
    #[serde(default = "weights")]
    #[schema(min_items = 2, max_items = 2)]
    pub weights: [f64; 2],
    #[serde(default)]
    pub diffusion: DiffusionSpec,
    #[serde(default)]
    pub sampler: SamplerSpec,
    #[serde(default, skip_serializing_if = "Residual::is_none")]
    pub residual: Residual,
}

/// What training does with the torques, which are known, and with y of the context.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Known {
    /// All that is known goes in without noise, and its errors do not count: what the paper's
    /// code does.
    #[default]
    CleanAndMasked,
    /// u is noised together with y, and its errors count with their own weight: a reading of the
    /// paper's text in which W matters. Sampling then noises the known u to each step's level.
    JointNoise,
}

const fn weights() -> [f64; 2] {
    [1.0, 3.0]
}

impl Check for DiffuserSpec {
    fn check(&self, report: &mut Report) {
        check_width(report, "width", self.width);
        report.length("multipliers.length", self.multipliers.len(), 1..=8);
        for (i, &multiplier) in self.multipliers.iter().enumerate() {
            report.within(&format!("multipliers[{i}]"), multiplier, 1..=64);
        }
        report.all_within("weights", &self.weights, &(1e-6..=1e6));
    }
}

impl ArchitectureSpec for DiffuserSpec {
    fn halvings(&self) -> usize {
        self.multipliers.len().saturating_sub(1)
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
