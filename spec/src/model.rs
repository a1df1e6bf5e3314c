use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Report};

/// A sequence model and its size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "architecture", rename_all = "kebab-case")]
pub enum ModelSpec {
    #[serde(rename = "robomorph")]
    RoboMorph(RoboMorphSpec),
}

/// Encoder-decoder Transformer that predicts the horizon in one pass (Bazzi et al. 2024).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RoboMorphSpec {
    /// Width of every token; a multiple of `heads`.
    pub d_model: u32,
    pub heads: u32,
    pub encoder_layers: u32,
    pub decoder_layers: u32,
    /// Samples per token; divides context and horizon. 1 in the paper.
    #[serde(default = "one")]
    pub patch: u32,
    /// Hidden width of the feed-forward blocks as a multiple of `d_model`.
    #[serde(default = "four")]
    pub mlp_ratio: u32,
}

const fn one() -> u32 {
    1
}
const fn four() -> u32 {
    4
}

impl ModelSpec {
    /// Samples per token: context and horizon must be multiples of it.
    pub fn patch(&self) -> u32 {
        match self {
            Self::RoboMorph(model) => model.patch,
        }
    }

    pub const fn architecture(&self) -> &'static str {
        match self {
            Self::RoboMorph(_) => "robomorph",
        }
    }
}

impl Check for ModelSpec {
    fn check(&self, report: &mut Report) {
        match self {
            Self::RoboMorph(model) => model.check(report),
        }
    }
}

impl Check for RoboMorphSpec {
    fn check(&self, report: &mut Report) {
        report.within("d_model", self.d_model, 8..=4096);
        report.within("heads", self.heads, 1..=64);
        report.within("encoder_layers", self.encoder_layers, 1..=64);
        report.within("decoder_layers", self.decoder_layers, 1..=64);
        report.within("patch", self.patch, 1..=1000);
        report.within("mlp_ratio", self.mlp_ratio, 1..=16);
        if self.heads > 0 && !self.d_model.is_multiple_of(self.heads) {
            report.violation(
                "d_model",
                self.d_model,
                format!("a multiple of heads, which is {}", self.heads),
            );
        }
    }
}
