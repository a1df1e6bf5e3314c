//! Sampling of models that generate predictions from noise.

use super::diffusion::{DiffusionSpec, SamplerKind, SamplerSpec};
use super::flow::{FLOW_LEVELS, FLOW_STEPS, FlowSpec};
use crate::check::Violations;

/// How such a model was trained to generate them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Generation<'a> {
    /// Removes noise level by level.
    Diffusion(&'a DiffusionSpec),
    /// Moves noise along a velocity.
    Flow(&'a FlowSpec),
}

impl Generation<'_> {
    /// The samplers that it supports.
    pub const fn samplers(&self) -> &'static [SamplerKind] {
        match self {
            Self::Diffusion(_) => &[SamplerKind::Ddpm, SamplerKind::Ddim, SamplerKind::DpmSolver],
            Self::Flow(_) => &[SamplerKind::Euler, SamplerKind::Heun],
        }
    }

    /// Default number of steps of a sampler.
    pub const fn all_steps(&self) -> u32 {
        match self {
            Self::Diffusion(diffusion) => diffusion.steps,
            Self::Flow(_) => FLOW_STEPS,
        }
    }

    /// The largest number of steps of a warm start.
    pub fn most_warm_steps(&self) -> u32 {
        match self {
            Self::Diffusion(diffusion) => diffusion.steps,
            Self::Flow(flow) => flow.warm_levels(),
        }
    }

    /// The source of [`Generation::most_warm_steps`], as errors name it.
    pub const fn limit_of_warm_steps(&self) -> &'static str {
        match self {
            Self::Diffusion(_) => "diffusion.steps",
            Self::Flow(_) => "1000 times warm_start_time",
        }
    }

    pub(super) fn report_sampler(&self, sampler: &SamplerSpec, violations: &mut Violations) {
        violations.part("sampler", sampler);
        let kinds = self.samplers();
        if !kinds.contains(&sampler.kind) {
            let kinds: Vec<String> = kinds.iter().map(ToString::to_string).collect();
            let model = match self {
                Self::Diffusion(_) => "removes noise level by level",
                Self::Flow(_) => "is a flow",
            };
            let allowed = format!("{} of a model that {model}", kinds.join(", "));
            violations.add("sampler.kind", sampler.kind, allowed);
        }
        let (most, limit) = match self {
            Self::Diffusion(diffusion) => (diffusion.steps, "diffusion.steps, which is "),
            Self::Flow(_) => (FLOW_LEVELS, "a flow's times, which are "),
        };
        if let Some(steps) = sampler.steps
            && steps > most
        {
            violations.add("sampler.steps", steps, format!("at most {limit}{most}"));
        }
    }
}
