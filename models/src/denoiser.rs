use burn::module::{Module, ModuleMapper, ModuleVisitor};
use burn::tensor::{Device, Tensor, TensorData};
use kernels::DropoutKeys;
use spec::{Generation, JOINTS, Known, ModelSpec};

use crate::ModelError;
use crate::cdcnn::Cdcnn;
use crate::cdt::{Cdt, Chain};
use crate::diffuser::Diffuser;
use crate::diffusion::{Painted, Process, Step};
use crate::randomness::Noise;
use crate::sequence_model::{Loss, ModelInput};

/// A network that removes noise. A flow's is CDCNN's.
#[derive(Clone, Debug)]
pub(crate) enum Network {
    Diffuser(Diffuser),
    Cdcnn(Box<Cdcnn>),
    Cdt(Cdt),
}

/// A network with what it was trained to do about the noise.
///
/// The series that is noised is y of the whole trajectory, for Diffuser u beside y. Its context
/// enters clean, in training and at every step of sampling, and its errors never count.
#[derive(Clone, Debug)]
pub(crate) struct Denoiser {
    network: Network,
    process: Process,
    /// Of Diffuser; the others are given u apart from the series.
    torques: Torques,
    /// Whether the path that answers are relative to is given beside u.
    path: bool,
}

/// What becomes of u.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Torques {
    /// Not in the series.
    Apart,
    /// In the series, clean, without errors; the weight of y's errors.
    Clean { y_weight: f64 },
    /// In the series, noised with y; the weights of the errors of u and y.
    Noised { weights: [f64; 2] },
}

impl Denoiser {
    /// # Errors
    /// [`ModelError::Spec`] for noise that cannot be.
    pub fn new(network: Network, spec: &ModelSpec) -> Result<Self, ModelError> {
        spec.check_options()?;
        let process = match spec.generation().ok_or(ModelError::NotGenerative)? {
            Generation::Diffusion(diffusion) => Process::diffusion(diffusion),
            Generation::Flow(flow) => Process::flow(flow),
        };
        let torques = match spec {
            ModelSpec::Diffuser(spec) => match (spec.known, spec.weights) {
                (Known::CleanAndMasked, [_, y_weight]) => Torques::Clean { y_weight },
                (Known::JointNoise, weights) => Torques::Noised { weights },
            },
            _ => Torques::Apart,
        };
        Ok(Self { network, process, torques, path: matches!(spec, ModelSpec::Flow(_)) })
    }

    pub fn process(&self) -> &Process {
        &self.process
    }

    pub fn loss(&self, input: ModelInput, target: Tensor<3>, noise: &mut Noise) -> Loss {
        let [_, context, _] = input.seen_context.dims();
        let [_, horizon, _] = target.dims();
        let device = target.device();
        let y = Tensor::cat(vec![input.seen_context, target], 1);
        let series = self.series(&input.u, y);
        let known = self.known(&input.u, &input.path);
        let shape = Shape { context, horizon, device: &device };
        let (clean, weights, counted) = match self.torques {
            Torques::Apart => {
                let weights = shape.mask(&[(0.0, 1.0)]);
                (shape.mask(&[(1.0, 0.0)]), weights, horizon * JOINTS)
            }
            Torques::Clean { y_weight } => {
                let weights = shape.mask(&[(0.0, 0.0), (0.0, y_weight)]);
                (shape.mask(&[(1.0, 1.0), (1.0, 0.0)]), weights, horizon * JOINTS)
            }
            Torques::Noised { weights: [of_u, of_y] } => {
                let weights = shape.mask(&[(of_u, of_u), (0.0, of_y)]);
                let counted = (context + 2 * horizon) * JOINTS;
                (shape.mask(&[(0.0, 0.0), (1.0, 0.0)]), weights, counted)
            }
        };
        let keys = noise.dropout_keys();
        self.process.loss(&series, &clean, weights, counted, noise, |noisy, levels| {
            self.forward(noisy, levels, known, keys)
        })
    }

    /// y of the horizon `[batch, horizon, 7]`, from noise or from the guess `warm` of it.
    pub fn sample(
        &self,
        input: &ModelInput,
        warm: Option<Tensor<3>>,
        steps: &[Step],
        noise: &mut Noise,
    ) -> Tensor<3> {
        let [batch, context, _] = input.seen_context.dims();
        let [_, samples, _] = input.u.dims();
        let horizon = samples - context;
        let device = input.u.device();
        let unknown = |device: &Device| Tensor::zeros([batch, horizon, JOINTS], device);
        let whole = |horizon: Tensor<3>| {
            self.series(&input.u, Tensor::cat(vec![input.seen_context.clone(), horizon], 1))
        };
        let shape = Shape { context, horizon, device: &device };
        let (clean, noised) = match self.torques {
            Torques::Apart => (shape.mask(&[(1.0, 0.0)]), None),
            Torques::Clean { .. } => (shape.mask(&[(1.0, 1.0), (1.0, 0.0)]), None),
            Torques::Noised { .. } => {
                (shape.mask(&[(0.0, 0.0), (1.0, 0.0)]), Some(shape.mask(&[(1.0, 1.0), (0.0, 0.0)])))
            }
        };
        let painted = Painted { values: whole(unknown(&device)), clean, noised };
        let warm = warm.map(whole);
        let series = if let Network::Cdt(network) = &self.network {
            let levels = steps.iter().map(|step| step.level).collect();
            let clean = input.seen_context.clone();
            let mut chain = Chain::new(network, clean.clone(), input.u.clone(), levels);
            self.process.sample(warm, &painted, steps, noise, |noisy, _| {
                let noisy = noisy.slice([0..batch, context..samples, 0..JOINTS]);
                // Nobody asks for the context's.
                Tensor::cat(vec![clean.zeros_like(), chain.answer(noisy)], 1)
            })
        } else {
            let known = self.known(&input.u, &input.path);
            self.process.sample(warm, &painted, steps, noise, |noisy, levels| {
                self.forward(noisy, levels, known.clone(), None)
            })
        };
        let [_, _, channels] = series.dims();
        series.slice([0..batch, context..samples, channels - JOINTS..channels])
    }

    /// What the network is given beside the series, `[batch, sample, channel]`.
    pub fn known(&self, u: &Tensor<3>, path: &Tensor<3>) -> Tensor<3> {
        if self.path { Tensor::cat(vec![u.clone(), path.clone()], 2) } else { u.clone() }
    }

    /// The network's answer at each row's noise level, in the shape of the noisy series. A step of
    /// training has keys for what it leaves out.
    pub fn forward(
        &self,
        noisy: Tensor<3>,
        levels: &[usize],
        known: Tensor<3>,
        keys: Option<DropoutKeys>,
    ) -> Tensor<3> {
        match &self.network {
            Network::Diffuser(network) => network.forward(noisy, levels),
            Network::Cdcnn(network) => network.forward(noisy, levels, known),
            Network::Cdt(network) => network.forward(noisy, levels, known, keys),
        }
    }

    /// What is noised.
    fn series(&self, u: &Tensor<3>, y: Tensor<3>) -> Tensor<3> {
        match self.torques {
            Torques::Apart => y,
            Torques::Clean { .. } | Torques::Noised { .. } => Tensor::cat(vec![u.clone(), y], 2),
        }
    }

    pub fn for_inference(&self) -> Self {
        let network = match &self.network {
            Network::Diffuser(network) => Network::Diffuser(network.valid()),
            Network::Cdcnn(network) => Network::Cdcnn(Box::new(network.valid())),
            Network::Cdt(network) => Network::Cdt(network.valid()),
        };
        Self { network, ..self.clone() }
    }

    pub fn visit<V: ModuleVisitor>(&self, visitor: &mut V) {
        match &self.network {
            Network::Diffuser(network) => network.visit(visitor),
            Network::Cdcnn(network) => network.visit(visitor),
            Network::Cdt(network) => network.visit(visitor),
        }
    }

    pub fn map<M: ModuleMapper>(self, mapper: &mut M) -> Self {
        let network = match self.network {
            Network::Diffuser(network) => Network::Diffuser(network.map(mapper)),
            Network::Cdcnn(network) => Network::Cdcnn(Box::new(network.map(mapper))),
            Network::Cdt(network) => Network::Cdt(network.map(mapper)),
        };
        Self { network, ..self }
    }
}

/// Extents of the series that masks are made for.
struct Shape<'a> {
    context: usize,
    horizon: usize,
    device: &'a Device,
}

impl Shape<'_> {
    /// `[1, sample, channel]` of, for each group of 7 channels, a value in the context and one in
    /// the horizon.
    #[expect(clippy::cast_possible_truncation, reason = "series are computed in f32")]
    fn mask(&self, groups: &[(f64, f64)]) -> Tensor<3> {
        let row = |pick: fn(&(f64, f64)) -> f64| {
            groups.iter().flat_map(move |group| [pick(group) as f32; JOINTS])
        };
        let mut values: Vec<f32> = Vec::new();
        for _ in 0..self.context {
            values.extend(row(|group| group.0));
        }
        for _ in 0..self.horizon {
            values.extend(row(|group| group.1));
        }
        let shape = [1, self.context + self.horizon, groups.len() * JOINTS];
        Tensor::from_data(TensorData::new(values, shape), self.device)
    }
}
