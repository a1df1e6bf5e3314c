use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::architecture::ArchitectureSpec;
use super::loss::PointLoss;
use super::matmul_precision::MatmulPrecision;
use super::residual::Residual;
use super::sizes::{check_transformer, four, one};
use crate::check::{Check, Violations};

/// Encoder-decoder Transformer that predicts the horizon in one pass (Bazzi et al. 2024).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RoboMorphSpec {
    /// Width of every token; a multiple of `heads`.
    pub d_model: u32,
    /// Number of heads of attention.
    pub heads: u32,
    /// Layers for the context.
    pub encoder_layers: u32,
    /// Layers for the horizon.
    pub decoder_layers: u32,
    /// Number of samples per token; divides context and horizon. 1 in the paper.
    #[serde(default = "one")]
    pub patch: u32,
    /// Hidden width of the feed-forward blocks as a multiple of `d_model`.
    #[serde(default = "four")]
    pub mlp_ratio: u32,
    /// The precision of the layers' matrix products.
    #[serde(default, skip_serializing_if = "MatmulPrecision::is_default")]
    pub matmul_precision: MatmulPrecision,
    /// Whether it predicts a number or a distribution for each position.
    #[serde(default, skip_serializing_if = "Head::is_default")]
    pub head: Head,
    /// Whether it predicts positions or displacements.
    #[serde(default, skip_serializing_if = "Output::is_default")]
    pub output: Output,
    /// The loss of a point head.
    #[serde(default, skip_serializing_if = "PointLoss::is_default")]
    pub loss: PointLoss,
    /// The path that predictions are added to.
    #[serde(default, skip_serializing_if = "Residual::is_none")]
    pub residual: Residual,
}

/// The numbers that a RoboMorph's head predicts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Output {
    /// The position of each sample, as in the paper. Nothing connects a patch to the one before.
    #[default]
    Positions,
    /// The displacement of each sample from the one before. Positions are their running sum, so a
    /// seam between patches is only a step between samples. For a gaussian head this is the mean.
    Displacements,
}

impl Output {
    fn is_default(&self) -> bool {
        *self == Self::Positions
    }
}

/// The form of the prediction of each position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Head {
    /// One number, trained with its squared error.
    #[default]
    Point,
    /// Mean and variance, trained with the likelihood of a normal distribution (Rufolo et al.
    /// 2024).
    Gaussian,
}

impl Head {
    fn is_default(&self) -> bool {
        *self == Self::Point
    }
}

impl Check for RoboMorphSpec {
    fn check(&self, violations: &mut Violations) {
        let layers =
            [("encoder_layers", self.encoder_layers), ("decoder_layers", self.decoder_layers)];
        check_transformer(violations, self.d_model, self.heads, &layers, self.mlp_ratio);
        violations.within("patch", self.patch, 1..=1000);
    }
}

impl ArchitectureSpec for RoboMorphSpec {
    fn patch(&self) -> u32 {
        self.patch
    }

    fn parts(&self) -> &'static [&'static str] {
        &[
            "encoder_input",
            "encoder_positions",
            "encoder_blocks",
            "encoder_norm",
            "decoder_input",
            "decoder_positions",
            "decoder_blocks",
            "decoder_norm",
            "head",
        ]
    }

    fn residual(&self) -> Residual {
        self.residual
    }

    fn report_options(&self, violations: &mut Violations) {
        if self.loss != PointLoss::MeanSquare && self.head != Head::Point {
            violations.add("loss", "root-mean-square", "mean-square, with a gaussian head");
        }
    }
}
