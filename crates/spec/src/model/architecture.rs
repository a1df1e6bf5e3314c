use super::diffusion::SamplerSpec;
use super::lagrangian::KnownRobot;
use super::lengths::Lengths;
use super::residual::Residual;
use super::sampling::Generation;
use crate::check::{Check, Violations};

/// The spec of one architecture: its sizes, its defaults, and the facts that jobs need to know
/// about it. [`Check`] checks the sizes.
pub(super) trait ArchitectureSpec: Check {
    /// Number of samples per token. Context and horizon must be multiples of it.
    fn patch(&self) -> u32 {
        1
    }

    /// Number of times that the model halves the samples.
    fn halvings(&self) -> usize {
        0
    }

    /// The parts of the network, which are the first words of its parameters' names.
    fn parts(&self) -> &'static [&'static str];

    fn residual(&self) -> Residual;

    /// Whether it computes in N·m and rad, so nothing is normalized.
    fn is_physical(&self) -> bool {
        false
    }

    /// The arm that it is told.
    fn robot(&self) -> Option<&KnownRobot> {
        None
    }

    /// The contexts and horizons that one training supports.
    fn lengths(&self) -> Lengths {
        Lengths::Trained
    }

    /// How predictions are generated; `None` for a model that predicts in one pass.
    fn generation(&self) -> Option<Generation<'_>> {
        None
    }

    /// The default sampler of a model that generates predictions from noise.
    fn sampler(&self) -> Option<&SamplerSpec> {
        None
    }

    /// Checks the model's own options that are not sizes.
    fn report_options(&self, _violations: &mut Violations) {}
}
