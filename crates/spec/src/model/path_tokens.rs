//! Fields of models that read tokens beside a path.

use super::residual::{DampedIntegrator, Residual};
use crate::check::Violations;

/// The path of their predictions by default.
pub(super) fn lagged_integrator() -> Residual {
    Residual::LaggedIntegrator(DampedIntegrator::default())
}

/// Checks the number of samples per token, and the shortest context that a model supports.
pub(super) fn check_tokens(violations: &mut Violations, patch: u32, least_context: Option<u32>) {
    violations.within("patch", patch, 1..=1000);
    let Some(least) = least_context else { return };
    violations.within("least_context", least, 3..=9_999);
    if patch > 0 && !least.is_multiple_of(patch) {
        violations.add("least_context", least, format!("a multiple of patch, which is {patch}"));
    }
}

/// Checks that there is a path.
pub(super) fn check_path(violations: &mut Violations, residual: Residual) {
    if residual.is_none() {
        violations.add("residual", "none", "integrator or lagged-integrator");
    }
}
