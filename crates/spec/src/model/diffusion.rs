//! The noise of denoisers in training, and the samplers that remove it.

use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};

/// How noise is added, and what a model is trained to predict from it. The defaults are the
/// paper's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DiffusionSpec {
    /// Number of noise levels in training; the paper's T.
    pub steps: u32,
    /// The noise of each level.
    pub schedule: NoiseSchedule,
    /// The quantity that the network predicts.
    pub prediction: Prediction,
    /// Limit of a sampler's estimate of the clean series, in standard deviations of the
    /// normalization; `null` for no limit. Below about 5 it cuts off positions that arms do reach.
    pub clip: Option<f64>,
    /// The divisor of the loss.
    pub loss_mean: LossMean,
}

/// The noise of each level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NoiseSchedule {
    /// ᾱ follows a squared cosine with offset 0.008; β is at most 0.999 (Nichol and Dhariwal 2021).
    #[default]
    Cosine,
    /// β from 1e-4 to 0.02 at 1000 steps, and in proportion for other numbers of steps (Ho et al.
    /// 2020).
    Linear,
}

/// The quantity that a model is trained to predict.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub enum Prediction {
    /// The noise ε.
    #[default]
    #[serde(rename = "noise")]
    Noise,
    /// The clean series.
    #[serde(rename = "x0")]
    Clean,
    /// √ᾱ ε - √(1 - ᾱ) x0 (Salimans and Ho 2022).
    #[serde(rename = "v")]
    Velocity,
}

/// The divisor of the sum of squared errors. Known entries have no errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LossMean {
    /// The number of entries that count.
    #[default]
    Unknown,
    /// The number of all entries, as in the paper's code.
    All,
}

/// How a series is generated from noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SamplerSpec {
    /// How noise is removed.
    pub kind: SamplerKind,
    /// Number of passes through the model, at most `diffusion.steps`; `null` for all of them. For a
    /// flow, the number of steps of its equation, at most 1000; `null` for 2. `heun` takes two
    /// passes for each step except the last.
    pub steps: Option<u32>,
    /// Share of DDPM's noise that DDIM adds again at each step. 0 for other kinds.
    pub eta: f64,
    /// The noise levels that fewer than all steps visit.
    pub spacing: Spacing,
}

/// A way to generate a series from noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SamplerKind {
    /// Ancestral sampling (Ho et al. 2020).
    #[default]
    Ddpm,
    /// Adds no noise of its own unless `eta` is above 0 (Song et al. 2021).
    Ddim,
    /// Second-order multistep DPM-Solver++ (Lu et al. 2022).
    #[serde(rename = "dpm-solver++")]
    DpmSolver,
    /// For flows only. Follows the velocity at the beginning of each step.
    Euler,
    /// For flows only. Follows the mean of the velocities at both ends of each step (Heun 1900).
    Heun,
}

impl SamplerKind {
    /// Whether it solves the equation of a flow. All other kinds remove noise level by level.
    pub(crate) const fn is_of_flow(self) -> bool {
        matches!(self, Self::Euler | Self::Heun)
    }
}

/// The training levels that K steps visit, out of T levels counted from 0. Index i counts steps
/// from 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Spacing {
    /// round(T (K - i) / K) - 1: begins at the noisiest (Lin et al. 2024).
    #[default]
    Trailing,
    /// ⌊T / K⌋ (K - 1 - i): ends at the cleanest, as DDIM's authors did.
    Leading,
    /// round((T - 1) (K - 1 - i) / (K - 1)): both; the noisiest when K is 1.
    Linspace,
}

impl fmt::Display for SamplerKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ddpm => "ddpm",
            Self::Ddim => "ddim",
            Self::DpmSolver => "dpm-solver++",
            Self::Euler => "euler",
            Self::Heun => "heun",
        })
    }
}

impl Default for DiffusionSpec {
    fn default() -> Self {
        Self {
            steps: 100,
            schedule: NoiseSchedule::default(),
            prediction: Prediction::default(),
            clip: None,
            loss_mean: LossMean::default(),
        }
    }
}

impl Default for SamplerSpec {
    fn default() -> Self {
        Self { kind: SamplerKind::default(), steps: None, eta: 0.0, spacing: Spacing::default() }
    }
}

impl Check for DiffusionSpec {
    fn check(&self, violations: &mut Violations) {
        violations.within("steps", self.steps, 1..=10_000);
        if let Some(clip) = self.clip {
            violations.within("clip", clip, 1.0..=1e6);
        }
    }
}

impl Check for SamplerSpec {
    fn check(&self, violations: &mut Violations) {
        if let Some(steps) = self.steps {
            violations.within("steps", steps, 1..=10_000);
        }
        violations.within("eta", self.eta, 0.0..=1.0);
        if self.kind != SamplerKind::Ddim && self.eta != 0.0 {
            violations.add("eta", self.eta, "0 unless kind is ddim");
        }
        if self.kind.is_of_flow() && self.spacing != Spacing::Trailing {
            let value = format!("{:?}", self.spacing).to_lowercase();
            violations.add("spacing", value, "trailing for the samplers of a flow");
        }
    }
}
