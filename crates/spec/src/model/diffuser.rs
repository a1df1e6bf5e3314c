use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::architecture::ArchitectureSpec;
use super::diffusion::{DiffusionSpec, SamplerSpec};
use super::residual::Residual;
use super::sampling::Generation;
use super::sizes::check_width;
use crate::check::{Check, Violations};

/// Temporal U-Net that removes noise from u and y of a whole trajectory at once. At every step the
/// known values replace its output (Janner et al. 2022).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DiffuserSpec {
    /// Channels of the first stage; a multiple of 8. 128 in the paper.
    pub width: u32,
    /// Channels of each stage as multiples of `width`. Every stage except the last halves the
    /// samples.
    pub multipliers: Vec<u32>,
    /// How training treats values that are known when the model predicts.
    #[serde(default)]
    pub known: Known,
    /// Weights of the squared errors of u and of y; the paper's W. With `clean-and-masked` only y
    /// has errors, and the second weight is only a scale.
    #[serde(default = "weights")]
    #[schema(min_items = 2, max_items = 2)]
    pub weights: [f64; 2],
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

/// How training treats known values: the torques, and y of the context.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Known {
    /// Known values have no noise, and their errors do not count. The paper's code does this.
    #[default]
    CleanAndMasked,
    /// u gets noise together with y, and its errors count with their own weight. This is a reading
    /// of the paper's text in which W matters. Sampling then adds each step's noise to the known u.
    JointNoise,
}

const fn weights() -> [f64; 2] {
    [1.0, 3.0]
}

impl Check for DiffuserSpec {
    fn check(&self, violations: &mut Violations) {
        check_width(violations, "width", self.width);
        violations.length("multipliers.length", self.multipliers.len(), 1..=8);
        for (i, &multiplier) in self.multipliers.iter().enumerate() {
            violations.within(&format!("multipliers[{i}]"), multiplier, 1..=64);
        }
        violations.all_within("weights", &self.weights, &(1e-6..=1e6));
    }
}

impl ArchitectureSpec for DiffuserSpec {
    fn halvings(&self) -> usize {
        self.multipliers.len().saturating_sub(1)
    }

    fn parts(&self) -> &'static [&'static str] {
        &["embedding", "unet"]
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
