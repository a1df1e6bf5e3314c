use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::architecture::ArchitectureSpec;
use super::lengths::Lengths;
use super::path_tokens::{check_path, check_tokens, lagged_integrator};
use super::residual::Residual;
use super::sizes::five;
use crate::check::{Check, Violations};

/// Gated recurrent units (Cho et al. 2014), which read the trajectory token by token. They predict in
/// one pass how far the arm departs from a path that continues the context, and compute in N·m, rad
/// and s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct GruSpec {
    /// Width of each layer's state.
    pub hidden: u32,
    /// Number of layers.
    pub layers: u32,
    /// Number of samples per token; divides context and horizon.
    #[serde(default = "five")]
    pub patch: u32,
    /// Length of the shortest context that the model supports, in samples; a multiple of `patch`.
    /// Each training step then ends the context at one random place from here on, and predicts
    /// everything after it. Default: the model supports only the context that it is trained with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub least_context: Option<u32>,
    /// The path that predictions are added to; not `none`.
    #[serde(default = "lagged_integrator")]
    pub residual: Residual,
}

impl Check for GruSpec {
    fn check(&self, violations: &mut Violations) {
        violations.within("hidden", self.hidden, 8..=4096);
        violations.within("layers", self.layers, 1..=64);
        check_tokens(violations, self.patch, self.least_context);
    }
}

impl ArchitectureSpec for GruSpec {
    fn patch(&self) -> u32 {
        self.patch
    }

    fn parts(&self) -> &'static [&'static str] {
        &["layers", "head"]
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
