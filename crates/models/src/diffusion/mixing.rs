//! How much noise each level has, and what a network predicts there.

use spec::{DiffusionSpec, FlowSpec, Prediction, SamplerSpec};

use super::flow::Flow;
use super::noise_schedule::NoiseSchedule;
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
            Self::Diffusion { schedule, .. } => noisy(schedule.signal(Some(level))),
            Self::Flow(_) => Flow::noisy(level),
        }
    }

    /// The weights of the clean series (first) and the noise (second) in the network's target.
    pub fn target(&self, level: usize) -> Mix {
        match self {
            Self::Diffusion { schedule, prediction } => {
                target(*prediction, schedule.signal(Some(level)))
            }
            Self::Flow(flow) => flow.target(),
        }
    }

    /// The weights of the noisy series (first) and the network's answer (second) in the clean
    /// series.
    pub fn clean(&self, level: usize) -> Mix {
        match self {
            Self::Diffusion { schedule, prediction } => {
                clean(*prediction, schedule.signal(Some(level)))
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

/// Weights of two series in a third.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mix {
    pub first: f64,
    pub second: f64,
}

/// The clean series without noise.
pub(crate) const CLEAN: Mix = Mix { first: 1.0, second: 0.0 };

/// The weights of the clean series (first) and the noise (second) in the noisy series.
pub(crate) fn noisy(signal: f64) -> Mix {
    Mix { first: signal.sqrt(), second: (1.0 - signal).sqrt() }
}

/// The weights of the clean series (first) and the noise (second) in the model's target.
pub(crate) fn target(prediction: Prediction, signal: f64) -> Mix {
    match prediction {
        Prediction::Noise => Mix { first: 0.0, second: 1.0 },
        Prediction::Clean => Mix { first: 1.0, second: 0.0 },
        Prediction::Velocity => Mix { first: -(1.0 - signal).sqrt(), second: signal.sqrt() },
    }
}

/// The weights of the noisy series (first) and the model's answer (second) in the clean series.
pub(crate) fn clean(prediction: Prediction, signal: f64) -> Mix {
    match prediction {
        Prediction::Noise => {
            Mix { first: signal.sqrt().recip(), second: -((1.0 - signal) / signal).sqrt() }
        }
        Prediction::Clean => Mix { first: 0.0, second: 1.0 },
        Prediction::Velocity => Mix { first: signal.sqrt(), second: -(1.0 - signal).sqrt() },
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use spec::Prediction;

    use super::{Mix, clean, noisy, target};

    fn mix(Mix { first, second }: Mix, a: f64, b: f64) -> f64 {
        first * a + second * b
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        #[test]
        fn the_right_answer_gives_the_clean_series_back(
            signal in 1e-4..0.9999, x0 in -5.0..5.0, noise in -5.0..5.0
        ) {
            let x = mix(noisy(signal), x0, noise);
            for prediction in [Prediction::Noise, Prediction::Clean, Prediction::Velocity] {
                let answer = mix(target(prediction, signal), x0, noise);
                let found = mix(clean(prediction, signal), x, answer);
                prop_assert!((found - x0).abs() < 1e-9, "{prediction:?}: {found} for {x0}");
            }
        }
    }
}
