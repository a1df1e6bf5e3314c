//! Samplers of denoisers in an evaluation.

use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::spec::EvaluateSpec;
use crate::check::{Check, Violations};
use crate::{ModelSpec, SamplerKind, SamplerSpec, Spacing};

/// A sampler for each denoiser, flows included, that supports its kind. It is used once for each
/// number of steps. Options that are left out come from the training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EvaluationSampler {
    /// How noise is removed. Default: as in the training.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<SamplerKind>,
    /// Steps of the sampler, at most `diffusion.steps`: a number or a list of numbers. With a warm
    /// start, these are the last noise levels, one by one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<SamplerSteps>,
    /// Share of DDPM's noise that DDIM adds again at each step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eta: Option<f64>,
    /// The noise levels that are visited. Default: as in the training.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing: Option<Spacing>,
    /// The starting point.
    #[serde(default)]
    pub start: Start,
}

/// One number of steps, or several numbers, each of which is evaluated.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum SamplerSteps {
    /// A single number.
    One(u32),
    /// A list of numbers.
    Each(Vec<u32>),
}

/// The starting point of a sampler.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Start {
    /// Starts from noise.
    #[default]
    Cold,
    /// Starts from the prediction of one sample ago, shifted by one, with its last position held,
    /// and with noise. This is an honest receding horizon: the first prediction starts cold with
    /// all steps.
    Shifted,
    /// Starts from the true horizon with noise. It contains what is to be predicted, and is
    /// labelled so everywhere.
    Oracle,
}

/// One way of sampling a denoiser.
#[derive(Clone, Debug, PartialEq)]
pub struct SamplingRun {
    /// The sampler of a cold start. Other starts take the last `steps` of its levels.
    pub sampler: SamplerSpec,
    /// Number of passes through the network.
    pub steps: u32,
    /// The starting point of the sampler.
    pub start: Start,
}

impl SamplerSteps {
    /// The numbers, in the order of the spec.
    pub fn each(&self) -> &[u32] {
        match self {
            Self::One(steps) => std::slice::from_ref(steps),
            Self::Each(steps) => steps,
        }
    }
}

impl fmt::Display for Start {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cold => "cold",
            Self::Shifted => "shifted",
            Self::Oracle => "oracle",
        })
    }
}

impl SamplingRun {
    /// The name that runs share if they differ only in steps, e.g. `ddim shifted`.
    pub fn curve(&self) -> String {
        self.label(None)
    }

    /// The name of the run, e.g. `ddim 5 shifted`. It differs for each run of a model.
    pub fn name(&self) -> String {
        self.label(Some(self.steps))
    }

    fn label(&self, steps: Option<u32>) -> String {
        let SamplerSpec { kind, eta, spacing, .. } = self.sampler;
        let mut parts = vec![kind.to_string()];
        parts.extend(steps.map(|steps| steps.to_string()));
        if eta != 0.0 {
            parts.push(format!("eta {eta}"));
        }
        // The spacing has no effect if levels are visited one by one.
        if self.start == Start::Cold && spacing != Spacing::default() {
            parts.push(format!("{spacing:?}").to_lowercase());
        }
        parts.push(self.start.to_string());
        parts.join(" ")
    }
}

impl EvaluateSpec {
    /// The ways of sampling `model`, in order. Empty if none of the `samplers` fits it.
    pub fn sampling_runs(&self, model: &ModelSpec) -> Vec<SamplingRun> {
        let (Some(generation), Some(own)) = (model.generation(), model.sampler()) else {
            return Vec::new();
        };
        let suited = self.samplers.iter().filter(|sampler| sampler.suits(model));
        suited.flat_map(|sampler| sampler.runs(own, generation.all_steps())).collect()
    }
}

impl EvaluationSampler {
    /// Whether the sampler fits `model`. Flows need other samplers than models that remove noise by
    /// levels.
    pub(crate) fn suits(&self, model: &ModelSpec) -> bool {
        model.generation().is_some_and(|generation| {
            self.kind.is_none_or(|kind| generation.samplers().contains(&kind))
        })
    }

    fn runs(&self, own: &SamplerSpec, levels: u32) -> Vec<SamplingRun> {
        let kind = self.kind.unwrap_or(own.kind);
        let own_eta = if kind == own.kind { own.eta } else { 0.0 };
        let run = |steps: u32| {
            let sampler = SamplerSpec {
                kind,
                // A warm start visits levels one by one, and the first prediction visits all of
                // them.
                steps: (self.start == Start::Cold).then_some(steps),
                eta: self.eta.unwrap_or(own_eta),
                spacing: self.spacing.unwrap_or(own.spacing),
            };
            SamplingRun { sampler, steps, start: self.start }
        };
        match &self.steps {
            Some(steps) => steps.each().iter().map(|&steps| run(steps)).collect(),
            None => vec![run(own.steps.unwrap_or(levels))],
        }
    }
}

impl Check for EvaluationSampler {
    fn check(&self, violations: &mut Violations) {
        if let Some(steps) = &self.steps {
            let each = steps.each();
            violations.length("steps", each.len(), 1..=100);
            for &steps in each {
                violations.within("steps", steps, 1..=10_000);
            }
            if each.windows(2).any(|pair| pair[0] >= pair[1]) {
                violations.add("steps", format!("{each:?}"), "numbers in rising order");
            }
        }
        if let Some(eta) = self.eta {
            violations.within("eta", eta, 0.0..=1.0);
        }
    }
}
