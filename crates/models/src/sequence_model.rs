//! A model of any of the architectures.

use burn::module::{ModuleMapper, ModuleVisitor};
use burn::tensor::Tensor;
use spec::ModelSpec;

use crate::ModelError;
use crate::architecture::{Architecture, Ask, Extents, FittedRobot, Model, ModelInput};
use crate::diffusion::Process;
use crate::initialization::InitialWeights;
use crate::loss::Loss;
use crate::randomness::Noise;

/// A model of any of the architectures that `spec` lists.
macro_rules! sequence_model {
    ($($name:ident($spec:ident) = $label:tt,)*) => {
        /// A model of one of the architectures. It is not a burn module itself, so that the names
        /// of parameters do not begin with the architecture's name.
        #[derive(Clone, Debug)]
        pub(crate) enum SequenceModel {
            $($name(Box<<spec::$spec as Architecture>::Model>),)*
        }

        /// Evaluates `$result` with `$model` of any architecture.
        macro_rules! of_any {
            ($self:expr, $model:ident => $result:expr) => {
                match $self { $(SequenceModel::$name($model) => $result,)* }
            };
        }

        impl SequenceModel {
            /// A model with initial weights.
            ///
            /// # Errors
            /// [`ModelError::Size`] for sizes that do not fit each other, [`ModelError::Spec`] for
            /// an invalid spec.
            pub fn new(
                spec: &ModelSpec,
                extents: Extents,
                weights: &mut InitialWeights<'_>,
            ) -> Result<Self, ModelError> {
                spec.check_options()?;
                Ok(match spec {
                    $(ModelSpec::$name(spec) => {
                        Self::$name(Box::new(spec.init(extents, weights)?))
                    })*
                })
            }

            /// The same weights, for inference only.
            pub fn for_inference(&self) -> Self {
                match self { $(Self::$name(model) => Self::$name(Box::new(model.for_inference())),)* }
            }

            pub fn begin(self, input: &ModelInput, seed: u64) -> Self {
                match self {
                    $(Self::$name(model) => Self::$name(Box::new(model.begin(input, seed))),)*
                }
            }

            pub fn map<M: ModuleMapper>(self, mapper: &mut M) -> Self {
                match self { $(Self::$name(model) => Self::$name(Box::new(model.map(mapper))),)* }
            }
        }
    };
}

spec::architectures!(sequence_model);

impl SequenceModel {
    pub fn loss(&self, input: ModelInput, target: Tensor<3>, noise: &mut Noise) -> Loss {
        of_any!(self, model => model.loss(input, target, noise))
    }

    pub fn answer(&self, input: ModelInput, ask: Ask<'_>) -> Tensor<3> {
        of_any!(self, model => model.answer(input, ask))
    }

    pub fn fit(&self, input: ModelInput) -> Option<Vec<FittedRobot>> {
        of_any!(self, model => model.fit(input))
    }

    pub fn kept(&self, extents: Extents) -> usize {
        of_any!(self, model => model.kept(extents))
    }

    pub fn is_generative(&self) -> bool {
        of_any!(self, model => model.is_generative())
    }

    pub fn process(&self) -> Option<&Process> {
        of_any!(self, model => model.process())
    }

    #[cfg(test)]
    pub fn answer_to_noise(
        &self,
        noisy: Tensor<3>,
        levels: &[usize],
        input: &ModelInput,
    ) -> Option<Tensor<3>> {
        of_any!(self, model => model.answer_to_noise(noisy, levels, input))
    }

    pub fn visit<V: ModuleVisitor>(&self, visitor: &mut V) {
        of_any!(self, model => model.visit(visitor));
    }
}
