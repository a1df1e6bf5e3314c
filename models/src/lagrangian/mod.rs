//! The equations of motion of an arm, learned from many robots, with what is particular to one robot fitted
//! to its context in closed form.
//!
//! A network of the pose gives a factor A of the mass matrix M = A Aᵀ + ε and coefficients C of the products
//! of velocities. At each sample
//!
//! ```text
//! M(q) Δv / h + C(q) [v̄ v̄] + D v = u
//! ```
//!
//! where Δv is the change of the mean velocity from one sampling time h to the next, v̄ their mean, and v
//! and u lie between both as a learned share says: in the middle for a heavy joint, at the newer one for a
//! light joint, whose velocity settles within the sampling time. Each robot has dampings D of its own,
//! normally distributed over robots.
//!
//! Training maximizes the likelihood of the context's torques, with the dampings at their most likely
//! values. No gradient passes through those: there the likelihood does not change with them to first order
//! (variable projection, Golub and Pereyra 1973). A prediction fits the dampings to the whole context and
//! integrates the equations over the horizon ([`law`]).

mod belief;
mod dense;
mod factored;
mod filtering;
mod fit;
mod law;
mod motion;
mod points;
#[cfg(test)]
mod tests;

use std::rc::Rc;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Tensor, TensorData, activation};
use rayon::prelude::*;
use series::MeasurementNoise;
use spec::{LagrangianSpec, MAX_JOINTS};

use self::dense::Dense;
use self::filtering::smoother;
use self::fit::Prior;
use self::law::Law;
use self::motion::{Recorded, products};
use self::points::{Fitted, Points};
use crate::ModelError;
use crate::activations::{Activations, Tally};
use crate::architecture::{Architecture, Ask, Extents, Model, ModelInput};
use crate::initialization::InitialWeights;
use crate::layers::Linear;
use crate::loss::Loss;
use crate::randomness::Noise;
use crate::sizes::{LARGEST_WIDTH, MOST_LAYERS, MOST_SAMPLES, within};

/// Added to the diagonal of the mass matrix, kg m².
const LEAST_INERTIA: f32 = 1e-3;

/// The learned numbers that stand alone are multiplied with this: at the pace of weights, the logarithm of
/// a noise would take a whole training to get from 0.3 N·m to 0.3 mN·m.
const PACE: f32 = 10.0;

/// Initial diagonal of A, √(kg m²).
const INITIAL_DIAGONAL: f32 = 0.3;
/// Largest initial weight of the head, times √width.
const INITIAL_HEAD: f32 = 0.35;
/// Initial standard deviation of the torque that is left over, N·m.
const INITIAL_NOISE: f32 = 0.3;
/// Initial share of the newer value.
const INITIAL_SHARE: f32 = 0.75;
/// A sample with one before it and one after it.
const LEAST_CONTEXT: u32 = 3;

impl Architecture for LagrangianSpec {
    type Model = Lagrangian;

    fn init(
        &self,
        Extents { context, joints, .. }: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Lagrangian, ModelError> {
        within("width", self.width, 1, LARGEST_WIDTH)?;
        within("layers", self.layers, 1, MOST_LAYERS)?;
        within("points", self.points, 1, MOST_SAMPLES)?;
        within("context", context, LEAST_CONTEXT, MOST_SAMPLES)?;
        let joints_of = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        let fewest = u32::from(self.turns_freely) + 1;
        within("joints", joints_of(joints), fewest, joints_of(MAX_JOINTS))?;
        let first = usize::from(self.turns_freely);
        let width = self.width as usize;
        let inputs = |layer: u32| if layer == 0 { 2 * (joints - first) } else { width };
        let mut biases = vec![0.0; joints * (joints + products(joints))];
        for joint in 0..joints {
            biases[joint * (joints + 1)] = INITIAL_DIAGONAL;
        }
        Ok(Lagrangian {
            hidden: (0..self.layers)
                .map(|layer| Linear::new(inputs(layer), width, weights))
                .collect(),
            head: Linear::near(&biases, width, INITIAL_HEAD / (width as f32).sqrt(), weights),
            share: weights.constant([joints], (INITIAL_SHARE / (1.0 - INITIAL_SHARE)).ln() / PACE),
            damping: weights.constant([joints], 0.0),
            damping_spread: weights.constant([joints], 0.0),
            noise: weights.constant([joints], INITIAL_NOISE.ln() / PACE),
            first,
            points: self.points.min(context - 2) as usize,
        })
    }
}

/// The learned part of the equations of motion, and the distribution of robots.
#[derive(Module, Debug)]
pub(crate) struct Lagrangian {
    hidden: Vec<Linear>,
    /// A row by row, then C row by row.
    head: Linear,
    /// Logit of each joint's share of the newer value, over [`PACE`].
    share: Param<Tensor<1>>,
    /// Logarithm of the mean of each joint's damping over robots, N·m·s/rad, over [`PACE`].
    damping: Param<Tensor<1>>,
    /// The same of its standard deviation over robots.
    damping_spread: Param<Tensor<1>>,
    /// The same of the standard deviation of the torque that is left over at a sample, N·m.
    noise: Param<Tensor<1>>,
    /// The first joint whose angle the network sees.
    #[module(skip)]
    first: usize,
    /// Samples of a trajectory that a step looks at.
    #[module(skip)]
    points: usize,
}

impl Lagrangian {
    /// The torques that inertia takes, N·m, `[robot, point, joint]`: from poses `[robot, point, 2 · input]`,
    /// accelerations `[robot · point, joint, 1]` and products of velocities `[robot · point, 1, product]`.
    fn inertial<A: Activations>(&self, pose: A, acceleration: A, products: A) -> A {
        let [robots, points, _] = pose.dims();
        let [rows, joints, _] = acceleration.dims();
        let [_, _, pairs] = products.dims();
        let mut x = pose;
        for layer in &self.hidden {
            x = tanh(layer.forward(x));
        }
        let numbers = self.head.forward(x);
        let squares = joints * joints;
        let factor = numbers.clone().part(2, 0..squares).reshaped([rows, joints, joints]);
        let coefficients =
            numbers.part(2, squares..squares + joints * pairs).reshaped([rows, joints, pairs]);
        let along = sum(weighted(factor.clone(), acceleration.clone()), 1);
        let inertia = sum(factor.times(along), 2);
        let coriolis = sum(weighted(coefficients, products), 2);
        let shape = [rows, joints, 1];
        let least = A::operation([acceleration], [false], shape, |[a]| a * LEAST_INERTIA);
        inertia.plus(coriolis).plus(least).reshaped([robots, points, joints])
    }

    /// The negative logarithm of the likelihood of the torques, less a constant, `[robot, point, joint]`.
    ///
    /// That of each entry given the dampings, and a point's part of what the dampings cost: how unlikely
    /// they are among robots, and how narrowly the points tell them.
    fn surprise(&self, inertial: Tensor<3>, points: &Points, fitted: &Fitted) -> Tensor<3> {
        let device = inertial.device();
        let [_, count, joints] = inertial.dims();
        let paced = |param: &Param<Tensor<1>>| (param.val() * PACE).unsqueeze::<3>();
        let [older, more] = points.missing(fitted, &device);
        let residual = inertial + older + more * activation::sigmoid(paced(&self.share));
        let log_noise = paced(&self.noise);
        let precision = (log_noise.clone() * -2.0).exp();
        let log_spread = paced(&self.damping_spread);
        let spread_precision = (log_spread.clone() * -2.0).exp();
        let unlikely = (fitted.damping(joints, &device) - paced(&self.damping).exp()).square();
        let told = fitted.squares(joints, &device) * precision.clone() + spread_precision.clone();
        let dampings = unlikely * spread_precision * 0.5 + log_spread + told.log() * 0.5;
        residual.square() * precision * 0.5 + log_noise + dampings / count as f64
    }

    /// The share of the newer value, and dampings, of each joint.
    fn priors(&self) -> Vec<Prior> {
        let [share, damping, spread, noise] =
            [&self.share, &self.damping, &self.damping_spread, &self.noise]
                .map(|param| values(param.val()));
        let paced = |value: f32| (PACE * value).exp();
        (0..share.len())
            .map(|joint| Prior {
                share: 1.0 / (1.0 + (-PACE * share[joint]).exp()),
                mean: paced(damping[joint]),
                spread: paced(spread[joint]),
                noise: paced(noise[joint]),
            })
            .collect()
    }

    /// The same law, ready to predict.
    fn law(&self) -> Law {
        let layers = self.hidden.iter().chain([&self.head]).map(|layer| {
            let (weight, bias) = layer.parameters();
            Dense::new(&values(weight), &values(bias))
        });
        Law::new(layers.collect(), self.priors(), self.first, LEAST_INERTIA)
    }
}

impl Model for Lagrangian {
    fn loss(&self, input: ModelInput, _: Tensor<3>, noise: &mut Noise) -> Loss {
        let device = input.u.device();
        let [robots, context, joints] = input.y_context.dims();
        let mut batch = HostBatch::new(&input);
        batch.smooth(input.measurement_noise);
        let stride = (context - 2) / self.points;
        let mut points = Points::new([robots, joints, self.points]);
        for (robot, offset) in noise.below(stride).into_iter().enumerate() {
            let recorded = batch.robot(robot);
            for point in 0..self.points {
                points.push(&recorded, 1 + offset + point * stride, self.first);
            }
        }
        let inertial = self.inertial(
            points.pose(&device),
            points.acceleration(&device),
            points.products(&device),
        );
        let fitted = points.fit(&values(inertial.clone()), &self.priors());
        let errors = self.surprise(inertial, &points, &fitted);
        let count = errors.shape().num_elements();
        Loss { errors, count, predicted: None }
    }

    fn answer(&self, input: ModelInput, _: Ask<'_>) -> Tensor<3> {
        let [robots, samples, joints] = input.u.dims();
        let [_, context, _] = input.y_context.dims();
        let batch = HostBatch::new(&input);
        let recorded: Vec<Recorded<'_>> = (0..robots).map(|robot| batch.robot(robot)).collect();
        let answer = self.law().predict_noisy(&recorded, input.measurement_noise);
        let shape = [robots, samples - context, joints];
        Tensor::from_data(TensorData::new(answer, shape), &input.u.device())
    }

    fn count(&self, extents: Extents, tally: &Rc<Tally>) {
        let (points, joints) = (self.points, extents.joints);
        let pose = tally.given([1, points, 2 * (joints - self.first)]);
        let acceleration = tally.given([points, joints, 1]);
        let products = tally.given([points, 1, products(joints)]);
        let _ = self.inertial(pose, acceleration, products);
        // The loss keeps arrays of torques, and as many of a robot's dampings, which are one more row.
        tally.given([KEPT_BY_LOSS, points + 1, joints]).keep();
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

/// Arrays in the shape of the torques that the loss keeps; of the dampings as many.
const KEPT_BY_LOSS: usize = 4;

/// Torques and positions of a batch where regressions are computed.
struct HostBatch {
    u: Vec<f32>,
    y: Vec<f32>,
    samples: usize,
    context: usize,
    joints: usize,
    rate_hz: f32,
}

impl HostBatch {
    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    fn new(input: &ModelInput) -> Self {
        let [_, samples, joints] = input.u.dims();
        let [_, context, _] = input.y_context.dims();
        Self {
            u: values(input.u.clone()),
            y: values(input.y_context.clone()),
            samples,
            context,
            joints,
            rate_hz: input.rate_hz as f32,
        }
    }

    /// Takes the noise out of positions: what is regressed are their differences.
    fn smooth(&mut self, noise: MeasurementNoise) {
        if noise.position_rad <= 0.0 || self.y.is_empty() {
            return;
        }
        let smoother = smoother(&self.robot(0), noise);
        let (joints, row) = (self.joints, self.context * self.joints);
        self.y.par_chunks_exact_mut(row).for_each(|y| {
            let smoothed = smoother.smooth_robot(y, joints);
            y.copy_from_slice(&smoothed);
        });
    }

    fn robot(&self, robot: usize) -> Recorded<'_> {
        let &Self { samples, context, joints, rate_hz, .. } = self;
        Recorded {
            u: &self.u[robot * samples * joints..][..samples * joints],
            y: &self.y[robot * context * joints..][..context * joints],
            joints,
            rate_hz,
        }
    }
}

/// The numbers of a tensor, whether or not gradients are asked of it.
fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.inner().into_data().iter().collect()
}

fn tanh<A: Activations>(x: A) -> A {
    let shape = x.dims();
    A::operation([x], [true], shape, |[x]| kernels::tanh(x))
}

/// The product with numbers that nothing is learned from, which may have extents of 1.
fn weighted<A: Activations>(x: A, weights: A) -> A {
    let shape = x.dims();
    A::operation([x, weights], [false, true], shape, |[x, weights]| x * weights)
}

fn sum<A: Activations>(x: A, dimension: usize) -> A {
    let mut shape = x.dims();
    shape[dimension] = 1;
    A::operation([x], [false], shape, |[x]| x.sum_dim(dimension))
}
