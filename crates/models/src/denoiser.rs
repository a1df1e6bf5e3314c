//! Models that make their answers from noise: a network and its task. The same network can be
//! trained without noise, to answer in one pass.

use burn::module::{Module, ModuleMapper, ModuleVisitor};
use burn::tensor::{Device, Tensor, TensorData};
use kernels::DropoutKeys;
use spec::PointLoss;

use crate::architecture::{Ask, Extents, Model, ModelInput};
use crate::diffusion::{Painted, Process, Step};
use crate::frame::KnownInputs;
use crate::loss::Loss;
use crate::randomness::Noise;

/// A network that removes noise.
pub(crate) trait Network: Module {
    /// The answer at each row's noise level, in the shape of the noisy series `[batch, sample,
    /// channel]`. The network also sees `known`, the known part of each sample. In training, `keys`
    /// choose the values that dropout leaves out.
    fn forward(
        &self,
        noisy: Tensor<3>,
        levels: &[usize],
        known: Tensor<3>,
        keys: Option<DropoutKeys>,
    ) -> Tensor<3>;

    /// The values that a training step keeps of a trajectory.
    fn kept(&self, extents: Extents) -> usize;

    /// Gives answers at one level after the other, `steps` in all, about the same trajectories.
    /// `clean` `[batch, context, channel]` are the first samples of these.
    fn chain<'a>(
        &'a self,
        _clean: &Tensor<3>,
        known: Tensor<3>,
        _steps: &[Step],
    ) -> impl FnMut(Tensor<3>, &[usize]) -> Tensor<3> + 'a {
        move |noisy, levels| self.forward(noisy, levels, known.clone(), None)
    }
}

/// The task that a network is trained on.
#[derive(Clone, Debug)]
pub(crate) enum Task {
    /// To remove noise.
    Denoise(Process),
    /// To answer in one pass. The unknown part of the series is 0.
    Predict(PointLoss),
}

/// The noise level that a network sees which answers in one pass.
const ONLY_LEVEL: usize = 0;

/// A network together with its task.
///
/// The noised series is y of the whole trajectory. For Diffuser it is u and y. The context enters
/// clean, in training and at every step of sampling, and its errors never count.
#[derive(Clone, Debug)]
pub(crate) struct Denoiser<N> {
    pub network: N,
    pub task: Task,
    pub torques: Torques,
    pub known_inputs: KnownInputs,
}

/// The place of u in the series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Torques {
    /// u is not in the series.
    Apart,
    /// u is in the series, clean, and its errors do not count. `y_weight` is the weight of y's
    /// errors.
    Clean { y_weight: f64 },
    /// u is in the series and noised with y. `weights` are those of the errors of u and of y.
    Noised { weights: [f64; 2] },
}

impl<N: Network> Model for Denoiser<N> {
    fn loss(&self, input: ModelInput, target: Tensor<3>, noise: &mut Noise) -> Loss {
        let [_, context, _] = input.seen_context.dims();
        let [_, horizon, joints] = target.dims();
        let device = target.device();
        let unit = input.unit_of_horizon();
        let known = self.known_inputs.series(&input);
        let y = Tensor::cat(vec![input.seen_context, target.clone()], 1);
        let series = self.series(&input.u, y);
        let shape = Shape { context, horizon, joints, device: &device };
        let (clean, weights, counted) = match self.torques {
            Torques::Apart => {
                let weights = shape.mask(&[(0.0, 1.0)]);
                (shape.mask(&[(1.0, 0.0)]), weights, horizon * joints)
            }
            Torques::Clean { y_weight } => {
                let weights = shape.mask(&[(0.0, 0.0), (0.0, y_weight)]);
                (shape.mask(&[(1.0, 1.0), (1.0, 0.0)]), weights, horizon * joints)
            }
            Torques::Noised { weights: [of_u, of_y] } => {
                let weights = shape.mask(&[(of_u, of_u), (0.0, of_y)]);
                let counted = (context + 2 * horizon) * joints;
                (shape.mask(&[(0.0, 0.0), (1.0, 0.0)]), weights, counted)
            }
        };
        let keys = noise.dropout_keys();
        match &self.task {
            Task::Denoise(process) => {
                process.loss(&series, &clean, weights, counted, noise, |noisy, levels| {
                    self.network.forward(noisy, levels, known, keys)
                })
            }
            Task::Predict(loss) => {
                let [batch, samples, channels] = series.dims();
                let levels = vec![ONLY_LEVEL; batch];
                let series = self.network.forward(series * clean, &levels, known, keys);
                let horizon = [0..batch, context..samples, channels - joints..channels];
                Loss::of_points(*loss, series.slice(horizon), target, unit)
            }
        }
    }

    fn answer(&self, input: ModelInput, ask: Ask<'_>) -> Tensor<3> {
        let Ask { steps, warm, noise, .. } = ask;
        let [batch, context, joints] = input.seen_context.dims();
        let [_, samples, _] = input.u.dims();
        let horizon = samples - context;
        let device = input.u.device();
        let unknown = Tensor::zeros([batch, horizon, joints], &device);
        let whole = |horizon: Tensor<3>| {
            self.series(&input.u, Tensor::cat(vec![input.seen_context.clone(), horizon], 1))
        };
        let shape = Shape { context, horizon, joints, device: &device };
        let (clean, noised) = match self.torques {
            Torques::Apart => (shape.mask(&[(1.0, 0.0)]), None),
            Torques::Clean { .. } => (shape.mask(&[(1.0, 1.0), (1.0, 0.0)]), None),
            Torques::Noised { .. } => {
                (shape.mask(&[(0.0, 0.0), (1.0, 0.0)]), Some(shape.mask(&[(1.0, 1.0), (0.0, 0.0)])))
            }
        };
        let painted = Painted { values: whole(unknown), clean, noised };
        let warm = warm.map(whole);
        let known = self.known_inputs.series(&input);
        let series = match &self.task {
            Task::Denoise(process) => {
                let chain = self.network.chain(&input.seen_context, known, steps);
                process.sample(warm, &painted, steps, noise, chain)
            }
            Task::Predict(_) => {
                self.network.forward(painted.values, &vec![ONLY_LEVEL; batch], known, None)
            }
        };
        let [_, _, channels] = series.dims();
        series.slice([0..batch, context..samples, channels - joints..channels])
    }

    fn kept(&self, extents: Extents) -> usize {
        let series = match self.torques {
            Torques::Apart => 1,
            Torques::Clean { .. } | Torques::Noised { .. } => 2,
        };
        let answer = extents.samples() as usize * series * extents.joints;
        self.network.kept(extents) + KEPT_BY_LOSS * answer
    }

    fn is_generative(&self) -> bool {
        matches!(self.task, Task::Denoise(_))
    }

    fn process(&self) -> Option<&Process> {
        match &self.task {
            Task::Denoise(process) => Some(process),
            Task::Predict(_) => None,
        }
    }

    #[cfg(test)]
    fn answer_to_noise(
        &self,
        noisy: Tensor<3>,
        levels: &[usize],
        input: &ModelInput,
    ) -> Option<Tensor<3>> {
        let known = self.known_inputs.series(input);
        Some(self.network.forward(noisy, levels, known, None))
    }

    fn for_inference(&self) -> Self {
        Self { network: self.network.valid(), ..self.clone() }
    }

    fn visit<V: ModuleVisitor>(&self, visitor: &mut V) {
        self.network.visit(visitor);
    }

    fn map<M: ModuleMapper>(self, mapper: &mut M) -> Self {
        Self { network: self.network.map(mapper), ..self }
    }
}

/// Arrays in the shape of the answer that the loss keeps for the backward pass: the differences
/// from the target and their squares.
const KEPT_BY_LOSS: usize = 2;

impl<N> Denoiser<N> {
    /// The series that is noised.
    fn series(&self, u: &Tensor<3>, y: Tensor<3>) -> Tensor<3> {
        match self.torques {
            Torques::Apart => y,
            Torques::Clean { .. } | Torques::Noised { .. } => Tensor::cat(vec![u.clone(), y], 2),
        }
    }
}

/// Extents of the series that a mask is made for.
struct Shape<'a> {
    context: usize,
    horizon: usize,
    joints: usize,
    device: &'a Device,
}

impl Shape<'_> {
    /// A mask `[1, sample, channel]`. `groups` has, for each group of as many channels as joints, a
    /// value in the context and one in the horizon.
    #[expect(clippy::cast_possible_truncation, reason = "series are computed in f32")]
    fn mask(&self, groups: &[(f64, f64)]) -> Tensor<3> {
        let row = |pick: fn(&(f64, f64)) -> f64| {
            let values = move |group| std::iter::repeat_n(pick(group) as f32, self.joints);
            groups.iter().flat_map(values)
        };
        let mut values: Vec<f32> = Vec::new();
        for _ in 0..self.context {
            values.extend(row(|group| group.0));
        }
        for _ in 0..self.horizon {
            values.extend(row(|group| group.1));
        }
        let shape = [1, self.context + self.horizon, groups.len() * self.joints];
        Tensor::from_data(TensorData::new(values, shape), self.device)
    }
}
