//! The sequence models and their sizes.

mod architecture;
mod cdcnn;
mod cdt;
mod diffuser;
mod diffusion;
mod flow;
mod gru;
mod lagrangian;
mod lengths;
mod loss;
mod matmul_precision;
mod path_tokens;
mod prefix_transformer;
mod residual;
mod robomorph;
mod sampling;
mod sizes;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::SpecError;
use crate::check::{Check, Violations};

pub use cdcnn::{CdcnnSpec, Conditioning};
pub use cdt::{CdtSpec, Objective};
pub use diffuser::{DiffuserSpec, Known};
pub use diffusion::{
    DiffusionSpec, LossMean, NoiseSchedule, Prediction, SamplerKind, SamplerSpec, Spacing,
};
pub use flow::{FLOW_LEVELS, FLOW_STEPS, FlowPrediction, FlowSpec};
pub use gru::GruSpec;
pub use lagrangian::{KnownRobot, LagrangianSpec, UnknownChain};
pub use lengths::{Length, Lengths};
pub use loss::PointLoss;
pub use matmul_precision::MatmulPrecision;
pub use prefix_transformer::PrefixTransformerSpec;
pub use residual::{DampedIntegrator, Residual};
pub use robomorph::{Head, Output, RoboMorphSpec};
pub use sampling::Generation;
pub use sizes::GROUPS;

use architecture::ArchitectureSpec;

/// Passes every architecture to a macro: its name in Rust, the type of its spec, and its name in
/// JSON. This is the only list of architectures.
#[macro_export]
macro_rules! architectures {
    ($macro:ident) => {
        $macro! {
            RoboMorph(RoboMorphSpec) = "robomorph",
            Diffuser(DiffuserSpec) = "diffuser",
            Cdcnn(CdcnnSpec) = "cdcnn",
            Cdt(CdtSpec) = "cdt",
            Flow(FlowSpec) = "flow",
            Lagrangian(LagrangianSpec) = "lagrangian",
            PrefixTransformer(PrefixTransformerSpec) = "prefix-transformer",
            Gru(GruSpec) = "gru",
        }
    };
}

macro_rules! model_spec {
    ($($name:ident($spec:ident) = $label:tt,)*) => {
        /// A sequence model and its sizes.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
        #[serde(tag = "architecture")]
        #[expect(missing_docs, reason = "the spec of each architecture says what it is")]
        pub enum ModelSpec {
            $(#[serde(rename = $label)] $name($spec),)*
        }

        impl ModelSpec {
            /// The names of all architectures in specs.
            pub const ARCHITECTURES: &[&str] = &[$($label),*];

            /// The name of the architecture in specs.
            pub const fn architecture(&self) -> &'static str {
                match self { $(Self::$name(_) => $label,)* }
            }

            fn spec(&self) -> &dyn ArchitectureSpec {
                match self { $(Self::$name(spec) => spec,)* }
            }
        }
    };
}

architectures!(model_spec);

impl ModelSpec {
    /// Number of samples per token. Context and horizon must be multiples of it.
    pub fn patch(&self) -> u32 {
        self.spec().patch()
    }

    /// The number of samples of a trajectory must be a multiple of this. A U-Net halves them at
    /// every stage except the last.
    pub fn stride(&self) -> u32 {
        let halvings = u32::try_from(self.spec().halvings()).unwrap_or(u32::MAX);
        1_u32.checked_shl(halvings).unwrap_or(u32::MAX)
    }

    /// The parts of its network, which are the first words of its parameters' names. With some
    /// options a part has no parameters.
    pub fn parts(&self) -> &'static [&'static str] {
        self.spec().parts()
    }

    /// The path that its predictions are added to.
    pub fn residual(&self) -> Residual {
        self.spec().residual()
    }

    /// Whether it computes in N·m and rad, so nothing is normalized.
    pub fn is_physical(&self) -> bool {
        self.spec().is_physical()
    }

    /// The arm that it is told.
    pub fn robot(&self) -> Option<&KnownRobot> {
        self.spec().robot()
    }

    /// The contexts and horizons that one training supports.
    pub fn lengths(&self) -> Lengths {
        self.spec().lengths()
    }

    /// How many times the rate of its training it is asked at, if it can answer
    /// ([`Lengths::multiple`]).
    pub fn multiple(&self, trained_hz: f64, asked_hz: f64) -> Option<usize> {
        self.lengths().multiple(trained_hz, asked_hz)
    }

    /// How predictions are generated; `None` for a model that predicts in one pass.
    pub fn generation(&self) -> Option<Generation<'_>> {
        self.spec().generation()
    }

    /// The default sampler of a model that generates predictions from noise.
    pub fn sampler(&self) -> Option<&SamplerSpec> {
        self.spec().sampler()
    }

    /// Checks that this model can be sampled with `sampler`.
    ///
    /// # Errors
    /// Every violation, with fields as `sampler.…`.
    pub fn check_sampler(&self, sampler: &SamplerSpec) -> Result<(), SpecError> {
        let mut violations = Violations::default();
        match self.generation() {
            Some(generation) => generation.report_sampler(sampler, &mut violations),
            None => {
                let allowed = "none, for a model that answers in one pass";
                violations.add("sampler", sampler.kind, allowed);
            }
        }
        violations.finish()
    }

    /// Checks everything except the sizes. The code that builds the model checks these against its
    /// own limits.
    ///
    /// # Errors
    /// Every violation.
    pub fn check_options(&self) -> Result<(), SpecError> {
        let mut violations = Violations::default();
        self.report_options(&mut violations);
        violations.finish()
    }

    fn report_options(&self, violations: &mut Violations) {
        if let Some(Generation::Diffusion(diffusion)) = self.generation() {
            violations.part("diffusion", diffusion);
        }
        if let (Some(generation), Some(sampler)) = (self.generation(), self.sampler()) {
            generation.report_sampler(sampler, violations);
        }
        violations.part("residual", &self.residual());
        self.spec().report_options(violations);
    }
}

impl Check for ModelSpec {
    fn check(&self, violations: &mut Violations) {
        self.spec().check(violations);
        self.report_options(violations);
    }
}
