use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::architecture::ArchitectureSpec;
use super::diffusion::{SamplerKind, SamplerSpec};
use super::residual::{DampedIntegrator, Residual};
use super::sampling::Generation;
use super::sizes::check_unet;
use crate::check::{Check, Violations};

/// Number of times at which a flow is trained, evenly from 1 / `FLOW_LEVELS` to 1.
pub const FLOW_LEVELS: u32 = 1000;

/// Default number of steps of a flow's sampler.
pub const FLOW_STEPS: u32 = 2;

/// U-Net with CDCNN's form that moves noise to y along straight lines (rectified flow, Liu et al.
/// 2022), given u and the damped integrator's path.
///
/// At time t, from 1 to 0, the series is (1 - t) y + t ε with ε standard normal.
/// Its velocity is ε - y.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FlowSpec {
    /// Width of the embedding of the time; even.
    pub embedding: u32,
    /// Channels of each stage, multiples of 8. Every stage except the last halves the samples.
    pub widths: Vec<u32>,
    /// The quantity that the network predicts.
    #[serde(default)]
    pub prediction: FlowPrediction,
    /// Time at which a warm start begins, between the clean series at 0 and noise at 1. The steps
    /// from there are even.
    #[serde(default = "half")]
    pub warm_start_time: f64,
    /// How predictions are sampled, unless a request names another sampler.
    #[serde(default = "few_steps")]
    pub sampler: SamplerSpec,
    /// The path that predictions are added to.
    #[serde(default = "integrator")]
    pub residual: Residual,
}

/// The quantity that a flow's network predicts. The velocity follows from it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub enum FlowPrediction {
    /// The clean series.
    #[default]
    #[serde(rename = "x0")]
    Clean,
    /// The velocity.
    #[serde(rename = "v")]
    Velocity,
}

const fn half() -> f64 {
    0.5
}

fn few_steps() -> SamplerSpec {
    SamplerSpec { kind: SamplerKind::Euler, steps: Some(FLOW_STEPS), ..SamplerSpec::default() }
}

fn integrator() -> Residual {
    Residual::Integrator(DampedIntegrator::default())
}

impl FlowSpec {
    /// The level at which a warm start begins, counted from 1. It is also the largest number of
    /// steps of a warm start.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "times are checked to be within 0.001 and 1"
    )]
    pub fn warm_levels(&self) -> u32 {
        (self.warm_start_time * f64::from(FLOW_LEVELS)).round() as u32
    }
}

impl Check for FlowSpec {
    fn check(&self, violations: &mut Violations) {
        check_unet(violations, self.embedding, &self.widths);
    }
}

impl ArchitectureSpec for FlowSpec {
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
        Some(Generation::Flow(self))
    }

    fn sampler(&self) -> Option<&SamplerSpec> {
        Some(&self.sampler)
    }

    fn report_options(&self, violations: &mut Violations) {
        violations.within("warm_start_time", self.warm_start_time, 0.001..=1.0);
    }
}
