//! The traits of an architecture, for code that trains models, stores them or predicts with them.

use std::fmt::Debug;

use burn::module::{ModuleMapper, ModuleVisitor};
use burn::tensor::Tensor;
use series::{JointMotion, MeasurementNoise};

use crate::ModelError;
use crate::diffusion::{Process, Step};
use crate::initialization::InitialWeights;
use crate::loss::Loss;
use crate::randomness::Noise;

/// Samples of the context and of the horizon of a trajectory, and joints of the arm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Extents {
    pub context: u32,
    pub horizon: u32,
    /// Channels of u, and also of y.
    pub joints: usize,
}

impl Extents {
    /// The extents of trajectories of `samples` samples of an arm with `joints` joints.
    ///
    /// # Errors
    /// [`ModelError::Size`] unless the context is 1 to `samples` - 1 samples.
    pub fn new(context: u32, samples: u32, joints: usize) -> Result<Self, ModelError> {
        match samples.checked_sub(context) {
            Some(horizon) if horizon > 0 && context > 0 => Ok(Self { context, horizon, joints }),
            _ => Err(ModelError::Size {
                field: "context",
                value: context.into(),
                allowed: format!("1 to {}, one less than the samples", samples.saturating_sub(1)),
            }),
        }
    }

    pub fn samples(self) -> u32 {
        self.context.saturating_add(self.horizon)
    }
}

/// A spec of an architecture, which makes models. The smallest one is in the tests below.
pub(crate) trait Architecture {
    type Model: Model;

    /// A model with initial weights.
    ///
    /// # Errors
    /// [`ModelError::Size`] for sizes that do not fit each other.
    fn init(
        &self,
        extents: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Self::Model, ModelError>;
}

/// A robot that explains a context. It says the torques that a motion takes, `[instant, joint]`, N·m.
pub type FittedRobot = Box<dyn Fn(&JointMotion) -> Vec<f32> + Send + Sync>;

/// A network together with its task.
pub(crate) trait Model: Clone + Debug {
    /// The model with what it reads off the first batch of a training, before its first step. `seed`
    /// is the training's.
    #[must_use]
    fn begin(self, _: &ModelInput, _seed: u64) -> Self {
        self
    }

    /// The loss on `target`, y of the horizon `[batch, horizon, joint]`.
    fn loss(&self, input: ModelInput, target: Tensor<3>, noise: &mut Noise) -> Loss;

    /// y of the horizon `[batch, horizon, joint]`, as the frame sees it.
    fn answer(&self, input: ModelInput, ask: Ask<'_>) -> Tensor<3>;

    /// The robots that explain the contexts, for a model with a law of torques. Other models predict
    /// motions only.
    fn fit(&self, _: ModelInput) -> Option<Vec<FittedRobot>> {
        None
    }

    /// The number of values that [`Model::loss`] keeps of one trajectory for the backward pass: the
    /// inputs of all operations whose derivative depends on them. It reads no weights. A test
    /// compares it with the memory that a forward pass takes.
    fn kept(&self, extents: Extents) -> usize;

    /// Whether the model can give several answers to the same question.
    fn is_generative(&self) -> bool;

    /// The diffusion or flow process of a model that makes its answers from noise.
    fn process(&self) -> Option<&Process> {
        None
    }

    /// The network's answer to a noisy series, for a model that makes its answers from noise.
    #[cfg(test)]
    fn answer_to_noise(&self, _: Tensor<3>, _: &[usize], _: &ModelInput) -> Option<Tensor<3>> {
        None
    }

    /// The same weights, without what training needs.
    fn for_inference(&self) -> Self;

    fn visit<V: ModuleVisitor>(&self, visitor: &mut V);

    fn map<M: ModuleMapper>(self, mapper: &mut M) -> Self;
}

/// The input of every architecture.
#[derive(Clone, Debug)]
pub(crate) struct ModelInput {
    /// Normalized torques `[batch, sample, joint]`.
    pub u: Tensor<3>,
    /// Normalized positions `[batch, context, joint]`.
    pub y_context: Tensor<3>,
    /// The same positions in the frame of the answers: [`crate::frame`].
    pub seen_context: Tensor<3>,
    /// The path that answers are relative to, as normalized positions `[batch, sample, joint]`.
    pub path: Tensor<3>,
    /// The unit of answers, in the same normalization `[batch, sample, joint]`.
    pub unit: Tensor<3>,
    pub rate_hz: f64,
    /// Noise of the positions, in rad, and of the torques of the context, in N·m.
    pub measurement_noise: MeasurementNoise,
}

impl ModelInput {
    /// The unit of answers `[batch, horizon, joint]`.
    pub fn unit_of_horizon(&self) -> Tensor<3> {
        let ([batch, samples, joints], [_, context, _]) = (self.unit.dims(), self.y_context.dims());
        self.unit.clone().slice([0..batch, context..samples, 0..joints])
    }
}

/// How a model computes an answer.
pub(crate) struct Ask<'a> {
    /// The sampler's steps, for a denoiser.
    pub steps: &'a [Step],
    /// A guess of y of the horizon, at which a denoiser begins.
    pub warm: Option<Tensor<3>>,
    pub noise: &'a mut Noise,
    /// Whether a model that knows its uncertainty draws from it.
    pub draw: Draw,
    /// Samples of the context with which the answer begins, at most two. Only the laws, which are
    /// asked at multiples of their rate, are asked for some.
    pub behind: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Draw {
    /// The mean, for a model that has one in closed form.
    Mean,
    Sample,
}

#[cfg(test)]
mod tests {
    use burn::module::Module;
    use burn::tensor::Device;
    use spec::PointLoss;

    use super::*;
    use crate::layers::Linear;

    /// An architecture whose answer at each sample is a linear map of the torques there.
    struct LinearSpec;

    impl Architecture for LinearSpec {
        type Model = LinearModel;

        fn init(
            &self,
            Extents { joints, .. }: Extents,
            weights: &mut InitialWeights<'_>,
        ) -> Result<LinearModel, ModelError> {
            Ok(LinearModel { map: Linear::new(joints, joints, weights) })
        }
    }

    #[derive(Module, Debug)]
    struct LinearModel {
        map: Linear,
    }

    impl LinearModel {
        /// Maps torques `[batch, sample, joint]` to y of the horizon `[batch, horizon, joint]`.
        fn forward(&self, input: &ModelInput) -> Tensor<3> {
            let [batch, samples, joints] = input.u.dims();
            let [_, context, _] = input.y_context.dims();
            self.map.forward(input.u.clone().slice([0..batch, context..samples, 0..joints]))
        }
    }

    impl Model for LinearModel {
        fn loss(&self, input: ModelInput, target: Tensor<3>, _: &mut Noise) -> Loss {
            let unit = input.unit_of_horizon();
            Loss::of_points(PointLoss::MeanSquare, self.forward(&input), target, unit)
        }

        fn answer(&self, input: ModelInput, _: Ask<'_>) -> Tensor<3> {
            self.forward(&input)
        }

        fn kept(&self, Extents { horizon, joints, .. }: Extents) -> usize {
            // The input of the map, its answer, and the errors before and after they are squared.
            4 * horizon as usize * joints
        }

        fn is_generative(&self) -> bool {
            false
        }

        fn for_inference(&self) -> Self {
            self.valid()
        }

        fn visit<V: ModuleVisitor>(&self, visitor: &mut V) {
            Module::visit(self, visitor);
        }

        fn map<M: ModuleMapper>(self, mapper: &mut M) -> Self {
            Module::map(self, mapper)
        }
    }

    #[test]
    fn the_smallest_architecture_answers_over_the_horizon() {
        let device = Device::flex();
        let extents = Extents::new(5, 8, 2).unwrap();
        let model = LinearSpec.init(extents, &mut InitialWeights::new(0, &device)).unwrap();
        let series = |samples| Tensor::ones([3, samples, 2], &device);
        let input = ModelInput {
            u: series(8),
            y_context: series(5),
            seen_context: series(5),
            path: series(8),
            unit: series(8),
            rate_hz: 60.0,
            measurement_noise: MeasurementNoise::default(),
        };
        let mut noise = Noise::new(std::iter::empty());
        let loss = model.loss(input.clone(), series(3), &mut noise);
        assert_eq!((loss.errors.dims(), loss.count), ([3, 3, 2], 18));
        let ask = Ask { steps: &[], warm: None, noise: &mut noise, draw: Draw::Mean, behind: 0 };
        assert_eq!(model.answer(input, ask).dims(), [3, 3, 2]);
        assert_eq!(model.kept(extents), 24);
    }
}
