//! How much noise each level has, and what a network predicts there.

use spec::{DiffusionSpec, FlowSpec, Prediction, SamplerSpec};

use super::flow::Flow;
use super::noise_schedule::NoiseSchedule;
use super::prediction::{self, Mix};
use super::sampler::{self, Step};

/// The amount of noise at each level, the target of a network there, and the steps of samplers from
/// level to level.
#[derive(Clone, Debug)]
pub(super) enum Mixing {
    Diffusion { schedule: NoiseSchedule, prediction: Prediction },
    Flow(Flow),
}

impl Mixing {
    pub fn diffusion(spec: &DiffusionSpec) -> Self {
        Self::Diffusion { schedule: NoiseSchedule::new(spec), prediction: spec.prediction }
    }

    pub fn flow(spec: &FlowSpec) -> Self {
        Self::Flow(Flow::new(spec))
    }

    pub fn levels(&self) -> usize {
        match self {
            Self::Diffusion { schedule, .. } => schedule.levels(),
            Self::Flow(_) => Flow::levels(),
        }
    }

    /// The weights of the clean series (first) and the noise (second) in the noisy series.
    pub fn noisy(&self, level: usize) -> Mix {
        match self {
            Self::Diffusion { schedule, .. } => prediction::noisy(schedule.signal(Some(level))),
            Self::Flow(_) => Flow::noisy(level),
        }
    }

    /// The weights of the clean series (first) and the noise (second) in the network's target.
    pub fn target(&self, level: usize) -> Mix {
        match self {
            Self::Diffusion { schedule, prediction } => {
                prediction::target(*prediction, schedule.signal(Some(level)))
            }
            Self::Flow(flow) => flow.target(),
        }
    }

    /// The weights of the noisy series (first) and the network's answer (second) in the clean
    /// series.
    pub fn clean(&self, level: usize) -> Mix {
        match self {
            Self::Diffusion { schedule, prediction } => {
                prediction::clean(*prediction, schedule.signal(Some(level)))
            }
            Self::Flow(flow) => flow.clean(level),
        }
    }

    pub fn steps(&self, sampler: &SamplerSpec, warm: Option<usize>) -> Vec<Step> {
        match self {
            Self::Diffusion { schedule, .. } => sampler::steps(schedule, sampler, warm),
            Self::Flow(flow) => flow.steps(sampler, warm),
        }
    }
}
