use super::diffusion::SamplerSpec;
use super::lengths::Lengths;
use super::residual::Residual;
use super::sampling::Generation;
use crate::check::{Check, Report};

/// The spec of one architecture: sizes, defaults, and what jobs must know of it. [`Check`] is for the
/// sizes.
pub(super) trait ArchitectureSpec: Check {
    /// Samples per token: context and horizon must be multiples of it.
    fn patch(&self) -> u32 {
        1
    }

    /// Times that samples are halved inside.
    fn halvings(&self) -> usize {
        0
    }

    fn residual(&self) -> Residual;

    /// Whether it computes in N·m and rad, so that nothing is normalized.
    fn is_physical(&self) -> bool {
        false
    }

    /// The contexts and horizons that one training answers.
    fn lengths(&self) -> Lengths {
        Lengths::Trained
    }

    /// None of a model that answers in one pass.
    fn generation(&self) -> Option<Generation<'_>> {
        None
    }

    /// The sampler of a model that makes its answers from noise, unless asked otherwise.
    fn sampler(&self) -> Option<&SamplerSpec> {
        None
    }

    /// Reports what is wrong with options of its own that are no sizes.
    fn report_options(&self, _report: &mut Report) {}
}
