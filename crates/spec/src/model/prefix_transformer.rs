use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::architecture::ArchitectureSpec;
use super::lengths::Lengths;
use super::matmul_precision::MatmulPrecision;
use super::path_tokens::{check_path, check_tokens, lagged_integrator};
use super::residual::Residual;
use super::sizes::{check_transformer, five, four};
use crate::check::{Check, Violations};

/// Transformer with one sequence of tokens over the whole trajectory. Attention is bidirectional in
/// the context and causal in the horizon (a prefix language model, Raffel et al. 2020). It predicts
/// in one pass how far the arm departs from a path that continues the context. It computes in N·m,
/// rad and s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PrefixTransformerSpec {
    /// Width of every token; a multiple of `heads`.
    pub d_model: u32,
    /// Number of heads of attention.
    pub heads: u32,
    /// Number of layers.
    pub layers: u32,
    /// Number of samples per token; divides context and horizon.
    #[serde(default = "five")]
    pub patch: u32,
    /// Hidden width of the feed-forward blocks as a multiple of `d_model`.
    #[serde(default = "four")]
    pub mlp_ratio: u32,
    /// The precision of the layers' matrix products.
    #[serde(default, skip_serializing_if = "MatmulPrecision::is_default")]
    pub matmul_precision: MatmulPrecision,
    /// Length of the shortest context that the model supports, in samples; a multiple of `patch`.
    /// Each training step then ends the context at one random place from here on, and predicts
    /// everything after it. Default: the model supports only the context that it is trained with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub least_context: Option<u32>,
    /// The path that predictions are added to; not `none`.
    #[serde(default = "lagged_integrator")]
    pub residual: Residual,
}

impl Check for PrefixTransformerSpec {
    fn check(&self, violations: &mut Violations) {
        let layers = [("layers", self.layers)];
        check_transformer(violations, self.d_model, self.heads, &layers, self.mlp_ratio);
        check_tokens(violations, self.patch, self.least_context);
    }
}

impl ArchitectureSpec for PrefixTransformerSpec {
    fn patch(&self) -> u32 {
        self.patch
    }

    fn parts(&self) -> &'static [&'static str] {
        &["input", "positions", "blocks", "norm", "head"]
    }

    fn residual(&self) -> Residual {
        self.residual
    }

    fn is_physical(&self) -> bool {
        true
    }

    fn lengths(&self) -> Lengths {
        self.least_context.map_or(Lengths::Trained, Lengths::From)
    }

    fn report_options(&self, violations: &mut Violations) {
        check_path(violations, self.residual);
    }
}
