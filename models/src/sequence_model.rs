use burn::module::{Module, ModuleMapper, ModuleVisitor};
use burn::tensor::Tensor;
use spec::ModelSpec;

use crate::ModelError;
use crate::initialization::InitialWeights;
use crate::robomorph::{RoboMorph, RoboMorphConfig};

/// What every architecture is given, normalized.
pub(crate) struct ModelInput {
    /// u, then y, of the context: `[batch, context, 14]`.
    pub context: Tensor<3>,
    /// u of the horizon: `[batch, horizon, 7]`.
    pub future_u: Tensor<3>,
}

/// One of the architectures. Not a burn module itself, so that parameter names do not begin with
/// the architecture's.
#[derive(Clone, Debug)]
pub(crate) enum SequenceModel {
    RoboMorph(RoboMorph),
}

impl SequenceModel {
    /// `context` and `horizon` in samples.
    pub fn new(
        spec: &ModelSpec,
        context: u32,
        horizon: u32,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Self, ModelError> {
        match spec {
            ModelSpec::RoboMorph(spec) => {
                let config = RoboMorphConfig::new(spec, context, horizon)?;
                Ok(Self::RoboMorph(config.init(weights)))
            }
        }
    }

    /// How many parameters [`SequenceModel::new`] would make, without making them.
    pub fn parameter_count(
        spec: &ModelSpec,
        context: u32,
        horizon: u32,
    ) -> Result<u64, ModelError> {
        match spec {
            ModelSpec::RoboMorph(spec) => {
                Ok(RoboMorphConfig::new(spec, context, horizon)?.parameter_count())
            }
        }
    }

    /// Gives y of the horizon `[batch, horizon, 7]`, normalized as the input is.
    pub fn forward(&self, input: ModelInput) -> Tensor<3> {
        match self {
            Self::RoboMorph(model) => model.forward(input),
        }
    }

    /// The same weights, without what training needs.
    pub fn for_inference(&self) -> Self {
        match self {
            Self::RoboMorph(model) => Self::RoboMorph(model.valid()),
        }
    }

    pub fn visit<V: ModuleVisitor>(&self, visitor: &mut V) {
        match self {
            Self::RoboMorph(model) => model.visit(visitor),
        }
    }

    pub fn map<M: ModuleMapper>(self, mapper: &mut M) -> Self {
        match self {
            Self::RoboMorph(model) => Self::RoboMorph(model.map(mapper)),
        }
    }
}
