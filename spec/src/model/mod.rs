//! The sequence models and their sizes.

mod cdcnn;
mod cdt;
mod diffuser;
mod diffusion;
mod flow;
mod residual;
mod robomorph;
mod sampling;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::SpecError;
use crate::check::{Check, Report};

pub use cdcnn::{CdcnnSpec, Conditioning};
pub use cdt::CdtSpec;
pub use diffuser::{DiffuserSpec, Known};
pub use diffusion::{
    DiffusionSpec, LossMean, NoiseSchedule, Prediction, SamplerKind, SamplerSpec, Spacing,
};
pub use flow::{FLOW_LEVELS, FLOW_STEPS, FlowPrediction, FlowSpec};
pub use residual::{DampedIntegrator, Residual};
pub use robomorph::{Head, RoboMorphSpec};
pub use sampling::Generation;

/// Channels that group normalization takes together are a width's share of this many.
pub const GROUPS: u32 = 8;

/// A sequence model and its size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "architecture", rename_all = "kebab-case")]
pub enum ModelSpec {
    #[serde(rename = "robomorph")]
    RoboMorph(RoboMorphSpec),
    Diffuser(DiffuserSpec),
    Cdcnn(CdcnnSpec),
    Cdt(CdtSpec),
    Flow(FlowSpec),
}

impl ModelSpec {
    /// Samples per token: context and horizon must be multiples of it.
    pub fn patch(&self) -> u32 {
        match self {
            Self::RoboMorph(model) => model.patch,
            Self::Diffuser(_) | Self::Cdcnn(_) | Self::Cdt(_) | Self::Flow(_) => 1,
        }
    }

    /// What the samples of a trajectory must be a multiple of: a U-Net halves them at every stage
    /// but the last.
    pub fn stride(&self) -> u32 {
        let stages = match self {
            Self::RoboMorph(_) | Self::Cdt(_) => 1,
            Self::Diffuser(model) => model.multipliers.len(),
            Self::Cdcnn(model) => model.widths.len(),
            Self::Flow(model) => model.widths.len(),
        };
        let halvings = u32::try_from(stages.saturating_sub(1)).unwrap_or(u32::MAX);
        1_u32.checked_shl(halvings).unwrap_or(u32::MAX)
    }

    pub const fn architecture(&self) -> &'static str {
        match self {
            Self::RoboMorph(_) => "robomorph",
            Self::Diffuser(_) => "diffuser",
            Self::Cdcnn(_) => "cdcnn",
            Self::Cdt(_) => "cdt",
            Self::Flow(_) => "flow",
        }
    }

    pub const fn residual(&self) -> Residual {
        match self {
            Self::RoboMorph(model) => model.residual,
            Self::Diffuser(model) => model.residual,
            Self::Cdcnn(model) => model.residual,
            Self::Cdt(model) => model.residual,
            Self::Flow(model) => model.residual,
        }
    }

    /// Everything but the sizes, which whoever builds the model checks against its own limits.
    ///
    /// # Errors
    /// Every violation.
    pub fn check_options(&self) -> Result<(), SpecError> {
        let mut report = Report::default();
        self.report_options(&mut report);
        report.finish()
    }

    fn report_options(&self, report: &mut Report) {
        match self.generation() {
            Some(Generation::Diffusion(diffusion)) => report.part("diffusion", diffusion),
            Some(Generation::Flow(flow)) => flow.report_options(report),
            None => {}
        }
        if let (Some(generation), Some(sampler)) = (self.generation(), self.sampler()) {
            generation.report_sampler(sampler, report);
        }
        report.part("residual", &self.residual());
        if let Self::Cdt(model) = self {
            model.report_dropout(report);
        }
    }
}

impl Check for ModelSpec {
    fn check(&self, report: &mut Report) {
        match self {
            Self::RoboMorph(model) => model.check(report),
            Self::Diffuser(model) => model.check(report),
            Self::Cdcnn(model) => model.check(report),
            Self::Cdt(model) => model.check(report),
            Self::Flow(model) => model.check(report),
        }
        self.report_options(report);
    }
}

/// Sizes of a Transformer that are the same in RoboMorph and CDT.
fn check_transformer(report: &mut Report, d_model: u32, heads: u32, layers: [u32; 2], ratio: u32) {
    report.within("d_model", d_model, 8..=4096);
    report.within("heads", heads, 1..=64);
    report.within("encoder_layers", layers[0], 1..=64);
    report.within("decoder_layers", layers[1], 1..=64);
    report.within("mlp_ratio", ratio, 1..=16);
    if heads > 0 && !d_model.is_multiple_of(heads) {
        report.violation("d_model", d_model, format!("a multiple of heads, which is {heads}"));
    }
}

/// Sizes of a U-Net that are the same in CDCNN and flow.
fn check_unet(report: &mut Report, embedding: u32, widths: &[u32]) {
    report.within("embedding", embedding, 4..=4096);
    if !embedding.is_multiple_of(2) {
        report.violation("embedding", embedding, "a multiple of 2, for sine and cosine");
    }
    report.within("widths.length", widths.len(), 1..=8);
    for (i, &width) in widths.iter().enumerate() {
        check_width(report, &format!("widths[{i}]"), width);
    }
}

/// A width of a U-Net, which group normalization divides.
fn check_width(report: &mut Report, field: &str, width: u32) {
    report.within(field, width, GROUPS..=4096);
    if !width.is_multiple_of(GROUPS) {
        let allowed = format!("a multiple of the groups of its normalization, which are {GROUPS}");
        report.violation(field, width, allowed);
    }
}

const fn one() -> u32 {
    1
}

const fn four() -> u32 {
    4
}
