//! The Transformer that removes noise.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::architecture::ArchitectureSpec;
use super::diffusion::{DiffusionSpec, SamplerSpec};
use super::loss::PointLoss;
use super::matmul_precision::MatmulPrecision;
use super::residual::Residual;
use super::sampling::Generation;
use super::sizes::{check_transformer, four, one};
use crate::check::{Check, Violations};
use crate::omitted::{is_one, is_zero};

/// Transformer that removes noise from y, given u through an encoder (Chi et al. 2023; the paper's
/// CDT).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CdtSpec {
    /// Width of every token; even and a multiple of `heads`.
    pub d_model: u32,
    /// Number of heads of attention.
    pub heads: u32,
    /// Layers for the noise level and u. 4 in the paper's code.
    pub encoder_layers: u32,
    /// Layers for the noisy y.
    pub decoder_layers: u32,
    /// Number of samples per token; divides context and horizon. 1 in the paper.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub patch: u32,
    /// Hidden width of the feed-forward blocks as a multiple of `d_model`.
    #[serde(default = "four")]
    pub mlp_ratio: u32,
    /// The precision of the layers' matrix products.
    #[serde(default, skip_serializing_if = "MatmulPrecision::is_default")]
    pub matmul_precision: MatmulPrecision,
    /// Dropout in training: the share of values that are dropped from attention's weights, after
    /// GELU, and from the output of each part of a layer. 0.1 in the paper's code, `p_drop_attn`.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub dropout: f64,
    /// Dropout of the tokens at the input of the layers. 0.1 in the paper's code, `p_drop_emb`.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub embedding_dropout: f64,
    /// Whether it removes noise or predicts in one pass.
    #[serde(default, skip_serializing_if = "Objective::is_default")]
    pub objective: Objective,
    /// The loss of a regression.
    #[serde(default, skip_serializing_if = "PointLoss::is_default")]
    pub loss: PointLoss,
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

/// The objective on which a CDT is trained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Objective {
    /// Removes noise, as in the paper.
    #[default]
    Denoising,
    /// Predicts the horizon in one pass. Its places in y are 0, and `diffusion` and `sampler` have
    /// no effect.
    Regression,
}

impl Objective {
    fn is_default(&self) -> bool {
        *self == Self::Denoising
    }
}

impl Check for CdtSpec {
    fn check(&self, violations: &mut Violations) {
        let layers =
            [("encoder_layers", self.encoder_layers), ("decoder_layers", self.decoder_layers)];
        check_transformer(violations, self.d_model, self.heads, &layers, self.mlp_ratio);
        violations.within("patch", self.patch, 1..=1000);
        if !self.d_model.is_multiple_of(2) {
            violations.add("d_model", self.d_model, "a multiple of 2, for sine and cosine");
        }
    }
}

impl ArchitectureSpec for CdtSpec {
    fn patch(&self) -> u32 {
        self.patch
    }

    fn parts(&self) -> &'static [&'static str] {
        &[
            "condition_input",
            "condition_positions",
            "encoder_blocks",
            "input",
            "positions",
            "decoder_blocks",
            "norm",
            "head",
        ]
    }

    fn residual(&self) -> Residual {
        self.residual
    }

    fn generation(&self) -> Option<Generation<'_>> {
        match self.objective {
            Objective::Denoising => Some(Generation::Diffusion(&self.diffusion)),
            Objective::Regression => None,
        }
    }

    fn sampler(&self) -> Option<&SamplerSpec> {
        match self.objective {
            Objective::Denoising => Some(&self.sampler),
            Objective::Regression => None,
        }
    }

    fn report_options(&self, violations: &mut Violations) {
        let shares = [("dropout", self.dropout), ("embedding_dropout", self.embedding_dropout)];
        for (field, share) in shares {
            violations.below_one(field, share);
        }
        if self.loss != PointLoss::MeanSquare && self.objective != Objective::Regression {
            let allowed = "mean-square, unless objective is regression";
            violations.add("loss", "root-mean-square", allowed);
        }
    }
}
