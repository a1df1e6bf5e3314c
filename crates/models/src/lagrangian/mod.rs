//! The equations of motion of an arm, learned from many robots. The numbers of one robot are fitted
//! to its context in closed form.
//!
//! The arm is a set of particles. A network of the pose gives the Jacobian B_pᵀ of each particle,
//! and forces G_k that depend on the pose alone, as gravity does. At each sample
//!
//! ```text
//! Σ_p w_p B_p (B_pᵀ Δv / h + Ḃ_pᵀ v̄) + J Δv / h + G_0 + Σ_k z_k G_k + D v + F φ(v) = u
//! ```
//!
//! where Δv is the change of the mean velocity from one sampling time h to the next, and v̄ is
//! their mean. v and u lie between both, at a learned share: in the middle for a heavy joint, and
//! at the newer one for a light joint, whose velocity settles within the sampling time. J is a
//! learned inertia of each joint, and φ is the learned shape of its friction. Weights w, strengths
//! z, dampings D ≥ 0 and frictions F ≥ 0 belong to a robot. Over robots they are independent and
//! normal. The mass matrix Σ w B Bᵀ + J is positive definite if all weights are positive. A robot
//! may have negative weights. The system that is solved for accelerations is positive definite for
//! all robots ([`linear_algebra`]). If asked, the inertia of each rotor and an offset of each torque
//! belong to a robot, too.
//!
//! A law that is told the arm has no network: its particles are at known places of the links and
//! have weight in gravity ([`kinematics`]). Moments of the links take the place of the weights, and
//! what it learns is how robots differ. A law can also find the lengths and axes itself, in the first
//! batch of a training ([`chain`]), and goes on as if it had been told.
//!
//! The equation is linear in a robot's numbers. Given its torques they are normal, too, in closed
//! form ([`regression`]). Training maximizes the likelihood of the context's torques by
//! expectation-maximization (Dempster, Laird and Rubin 1977), with a step of the optimizer for each
//! batch. A prediction fits the numbers to the whole context and integrates the equation over the
//! horizon ([`fitting`], [`rollout`]). Draws do the same with other numbers that the context allows
//! ([`draws`], [`scoring`]).

mod batch;
mod beginning;
mod chain;
mod disturbance;
mod draws;
mod features;
mod filtering;
mod fitting;
mod initial;
mod kinematics;
mod law;
mod linear_algebra;
mod nominal;
mod pose;
mod prediction;
mod recorded;
mod regression;
mod rollout;
mod scoring;
#[cfg(test)]
mod tests;
mod torques;

use std::sync::Arc;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Device, Tensor, TensorData, activation};
use simd::InstructionSet;
use spec::Gravity;

use self::batch::{HostBatch, Points, Posteriors};
use self::chain::FoundChain;
use self::kinematics::Kinematics;
use self::law::{Calibration, JointLaw, Law, Limits, Network, Places};
use self::linear_algebra::Dense;
use self::recorded::{Motion, Recorded};
use self::regression::{Numbers, Prior};
use crate::architecture::{Ask, Draw, Extents, FittedRobot, Model, ModelInput};
use crate::layers::Linear;
use crate::loss::Loss;
use crate::randomness::Noise;

/// Scalar parameters are stored divided by this, so that they learn faster. At the pace of weights,
/// the logarithm of a noise would need a whole training to get from 0.3 N·m to 0.3 mN·m.
const PACE: f32 = 10.0;
/// The same factor for [`Calibration`], which follows the law until the last steps of a training.
const CALIBRATION_PACE: f32 = 30.0;

/// Least share of the newer value. With a smaller share, the steps of a joint without inertia would
/// oscillate with growing amplitude.
const LEAST_SHARE: f32 = 0.5;
/// The learned part of the equations of motion, and the distribution of robots.
#[derive(Module, Debug)]
pub(crate) struct Lagrangian {
    hidden: Vec<Linear>,
    /// Jacobians, `[direction, particle, joint]`, √kg m. `None` where the arm is told.
    particles: Option<Linear>,
    /// `[1 + force, joint]`, in [`law::FORCE_UNIT`]. The first force acts on every robot.
    forces: Option<Linear>,
    /// Logit of each joint's share of the newer value, as a position between [`LEAST_SHARE`] and 1,
    /// over [`PACE`].
    share: Param<Tensor<1>>,
    /// Logarithm of each joint's inertia that no pose changes, kg m², over [`PACE`].
    armature: Param<Tensor<1>>,
    chain: Option<FoundChain>,
    /// Mean of each moment of a body over robots, where the arm is told or found.
    masses: Option<Param<Tensor<1>>>,
    /// Logarithm of the mean of each rotor inertia over robots, kg m², over [`PACE`].
    rotor: Option<Param<Tensor<1>>>,
    /// Logarithm of the mean of each joint's damping over robots, N·m·s/rad, over [`PACE`].
    damping: Param<Tensor<1>>,
    /// Mean of each joint's friction over robots, in its unit, over [`PACE`].
    friction: Param<Tensor<1>>,
    /// Logarithm of the slope of each joint's friction at its steepest, s/rad, over [`PACE`].
    friction_slope: Param<Tensor<1>>,
    /// The velocity at which each joint's friction is steepest, negated, rad/s.
    friction_shift: Param<Tensor<1>>,
    /// Logarithm of the standard deviation over robots of each number of a robot, over [`PACE`].
    spread: Param<Tensor<1>>,
    /// Logarithm of the standard deviation of each joint's residual torque at a sample, N·m, over
    /// [`PACE`].
    noise: Param<Tensor<1>>,
    /// The numbers of [`Calibration`] in order, over [`CALIBRATION_PACE`]. Checkpoints have this
    /// name.
    doubt: Param<Tensor<1>>,
    /// The first joint whose angle the network sees.
    #[module(skip)]
    first: usize,
    #[module(skip)]
    numbers: Numbers,
    /// The unit of each joint's mean friction, N·m.
    #[module(skip)]
    friction_units: Vec<f32>,
    /// Where predictions of each joint stay.
    #[module(skip)]
    limits: Vec<Limits>,
    /// Whether residual torques go on over the horizon.
    #[module(skip)]
    disturbance: bool,
    /// The arm that the law is told.
    #[module(skip)]
    told: Option<Kinematics>,
    /// Whether the torques of the arm that the law finds carry its weight.
    #[module(skip)]
    gravity: Gravity,
    /// Samples of each trajectory in a training step.
    #[module(skip)]
    points: usize,
}

impl Lagrangian {
    /// The equations of points. The first tensor has the factor of each number, and last that of
    /// the force that acts on every robot, `[robot, point · joint, number + 1]`. The second has the
    /// torques on the right-hand side, N·m, `[robot, point, joint]`.
    fn equations(&self, points: &Points, device: &Device) -> [Tensor<3>; 2] {
        let more = activation::sigmoid(self.paced(&self.share)) * (1.0 - LEAST_SHARE);
        let share = more + LEAST_SHARE;
        let between = |older: fn(&Motion) -> f32, more: fn(&Motion) -> f32| {
            points.of_joints(older, device) + points.of_joints(more, device) * share.clone()
        };
        let velocity = between(|motion| motion.velocity, |motion| motion.change);
        let torque = between(|motion| motion.torque, |motion| motion.step);
        let shape @ [robots, count, joints] = velocity.dims();
        let rows = [robots * count, joints, 1];
        let each = Tensor::<2>::eye(joints, device).unsqueeze::<3>();
        let own = |factor: Tensor<3>| factor.reshape(rows) * each.clone();
        let acceleration = points.acceleration(device);
        let [shared, common] = match self.kinematics() {
            Some(kinematics) => {
                let instructions = InstructionSet::best();
                let known = kinematics.torques_of_moments(instructions, points.states());
                let known = TensorData::new(known, [rows[0], joints, self.numbers.particles]);
                let none = Tensor::zeros([rows[0], joints, 1], device);
                [Tensor::from_data(known, device), none]
            }
            None => self.features(points.samples(device)),
        };
        let friction = self.friction(velocity.clone());
        let mut factors = vec![shared, own(velocity), own(friction)];
        if self.numbers.rotors {
            factors.push(own(acceleration.clone()));
        }
        if self.numbers.offsets {
            factors.push(own(acceleration.ones_like()));
        }
        factors.push(common);
        let factors = Tensor::cat(factors, 2);
        let inertia = acceleration * self.paced(&self.armature).exp();
        let width = self.numbers.count() + 1;
        [factors.reshape([robots, count * joints, width]), (torque - inertia).reshape(shape)]
    }

    /// The negative log-likelihood of the torques up to a constant, `[robot, point, joint]`, for
    /// given posteriors. Its gradient is exact all the same: expectation-maximization follows it.
    fn negative_log_likelihood(
        &self,
        equations: [Tensor<3>; 2],
        posteriors: &Posteriors,
    ) -> Tensor<3> {
        let [factors, torque] = equations;
        let shape @ [_, count, joints] = torque.dims();
        let device = torque.device();
        // The torques of every combination of numbers, `[robot, point · joint, column]`.
        let combined = factors.matmul(posteriors.combinations(&device));
        let expected = combined.clone().narrow(2, 0, 1).reshape(shape);
        let uncertainty = combined.narrow(2, 1, self.numbers.count()).square().sum_dim(2);
        let squares = (expected - torque).square() + uncertainty.reshape(shape);
        let log_noise = self.paced(&self.noise);
        let precision = (log_noise.clone() * -2.0).exp();
        let of_numbers = self.divergence_from_prior(posteriors) / (count * joints) as f64;
        squares * precision * 0.5 + log_noise + of_numbers
    }

    /// The divergence of a robot's posterior from the prior, `[robot, 1, 1]`: the cross-entropy of
    /// its numbers under the prior, less the entropy of the posterior.
    fn divergence_from_prior(&self, posteriors: &Posteriors) -> Tensor<3> {
        let device = self.spread.val().device();
        let Numbers { particles, forces, .. } = self.numbers;
        let constant = |value: f32, count: usize| {
            Tensor::<3>::from_data(TensorData::new(vec![value; count], [1, 1, count]), &device)
        };
        let mut means = vec![match &self.masses {
            Some(masses) => masses.val().unsqueeze(),
            None => constant(1.0, particles),
        }];
        if forces > 0 {
            means.push(constant(0.0, forces));
        }
        let units = TensorData::new(self.friction_units.clone(), [1, 1, self.numbers.joints]);
        let friction = self.paced(&self.friction) * Tensor::from_data(units, &device);
        means.extend([self.paced(&self.damping).exp(), friction]);
        means.extend(self.rotor.as_ref().map(|rotor| self.paced(rotor).exp()));
        if self.numbers.offsets {
            means.push(constant(0.0, self.numbers.joints));
        }
        let log_spread = self.paced(&self.spread);
        let off = posteriors.mean(&device) - Tensor::cat(means, 2);
        let squares = off.square() + posteriors.variance(&device);
        let unlikely = squares * (log_spread.clone() * -2.0).exp() * 0.5 + log_spread.clone();
        // The width of the posterior is a constant: it does not change with the spreads.
        let widths: f32 = values(log_spread).into_iter().sum();
        let given = f64::from(widths) + 0.5 * self.numbers.count() as f64;
        unlikely.sum_dim(2) + posteriors.information_gain(&device) - given
    }

    /// The arm that the law is told, or has found.
    fn kinematics(&self) -> Option<Kinematics> {
        let found = self.chain.as_ref().map(|chain| chain.kinematics(self.gravity));
        found.or_else(|| self.told.clone())
    }

    /// Whether particles are at places of links, which the law is told or has found.
    fn has_links(&self) -> bool {
        self.masses.is_some()
    }

    fn limits(&self) -> Vec<Limits> {
        self.chain.as_ref().map_or_else(|| self.limits.clone(), FoundChain::limits)
    }

    fn paced(&self, param: &Param<Tensor<1>>) -> Tensor<3> {
        (param.val() * PACE).unsqueeze()
    }

    /// The constants of each joint, which all robots share.
    fn joint_laws(&self) -> Vec<JointLaw> {
        let [share, armature, noise, slope, shift] =
            [&self.share, &self.armature, &self.noise, &self.friction_slope, &self.friction_shift]
                .map(|param| values(param.val()));
        let paced = |value: f32| (PACE * value).exp();
        let limits = self.limits();
        (0..share.len())
            .map(|joint| JointLaw {
                share: LEAST_SHARE + (1.0 - LEAST_SHARE) / (1.0 + (-PACE * share[joint]).exp()),
                armature: paced(armature[joint]),
                noise: paced(noise[joint]),
                friction_slope: paced(slope[joint]),
                friction_shift: shift[joint],
                limits: limits[joint],
            })
            .collect()
    }

    fn prior(&self) -> Prior {
        let [damping, friction, spread] = [&self.damping, &self.friction, &self.spread]
            .map(|param| values(param.val() * PACE).into_iter().map(f64::from));
        let paced =
            |param: &Param<Tensor<1>>| values(param.val() * PACE).into_iter().map(f64::from);
        let mut mean = match &self.masses {
            Some(masses) => values(masses.val()).into_iter().map(f64::from).collect(),
            None => vec![1.0; self.numbers.particles],
        };
        mean.extend(std::iter::repeat_n(0.0, self.numbers.forces));
        let units = self.friction_units.iter().copied().map(f64::from);
        mean.extend(damping.map(f64::exp));
        mean.extend(friction.zip(units).map(|(friction, unit)| friction * unit));
        mean.extend(self.rotor.iter().flat_map(paced).map(f64::exp));
        mean.resize(self.numbers.count(), 0.0);
        Prior { mean, spread: spread.map(f64::exp).collect() }
    }

    fn calibration(&self) -> Calibration {
        let values = values(self.doubt.val() * CALIBRATION_PACE);
        Calibration { log_median: values[0], log_spread: values[1], log_torque: values[2] }
    }

    /// The same law in a form that predicts.
    fn law(&self) -> Law {
        let dense = |layer: &Linear| {
            let (weight, bias) = layer.parameters();
            Dense::new(&values(weight), &values(bias))
        };
        let places = match (self.kinematics(), &self.particles) {
            (Some(kinematics), _) => Places::Known(kinematics),
            (None, Some(particles)) => Places::Learned(Network {
                hidden: self.hidden.iter().map(dense).collect(),
                particles: dense(particles),
                forces: self.forces.as_ref().map(dense),
                first: self.first,
            }),
            (None, None) => unreachable!("a law that is told no arm has a network"),
        };
        Law {
            places,
            joints: self.joint_laws(),
            prior: self.prior(),
            calibration: self.calibration(),
            numbers: self.numbers,
            disturbance: self.disturbance,
            points: self.points,
        }
    }
}

impl Model for Lagrangian {
    fn loss(&self, input: ModelInput, target: Tensor<3>, noise: &mut Noise) -> Loss {
        let device = input.u.device();
        let [robots, context, joints] = input.y_context.dims();
        let mut batch = HostBatch::new(&input);
        batch.smooth(input.measurement_noise);
        let stride = (context - 2) / self.points;
        let mut points = Points::new([robots, joints, self.points], self.first);
        for (robot, offset) in noise.below(stride).into_iter().enumerate() {
            let recorded = batch.robot(robot);
            for point in 0..self.points {
                points.push(&recorded, 1 + offset + point * stride);
            }
        }
        let equations = self.equations(&points, &device);
        let [factors, torques] = equations.each_ref().map(|tensor| values(tensor.clone()));
        let (laws, prior) = (self.joint_laws(), self.prior());
        let posteriors = points.fit(&factors, &torques, &laws, &prior, self.numbers);
        let errors = self.negative_log_likelihood(equations, &posteriors);
        let count = errors.shape().num_elements();
        let errors = errors + self.score(&batch, target, noise);
        Loss { errors, count, predicted: None }
    }

    fn answer(&self, input: ModelInput, ask: Ask<'_>) -> Tensor<3> {
        let [robots, samples, joints] = input.u.dims();
        let [_, context, _] = input.y_context.dims();
        let batch = HostBatch::new(&input);
        let recorded: Vec<Recorded<'_>> = (0..robots).map(|robot| batch.robot(robot)).collect();
        let law = self.law();
        let normals = match ask.draw {
            Draw::Mean => Vec::new(),
            Draw::Sample => {
                values(ask.noise.normal([1, law.normals_per_draw()], &input.u.device()))
            }
        };
        let draws: Vec<&[f32]> = normals.chunks_exact(law.normals_per_draw()).collect();
        let instructions = InstructionSet::best();
        let noise = input.measurement_noise;
        let answer = law.predict(instructions, &recorded, noise, &draws, ask.behind);
        let shape = [robots, ask.behind + samples - context, joints];
        Tensor::from_data(TensorData::new(answer, shape), &input.u.device())
    }

    fn fit(&self, input: ModelInput) -> Option<Vec<FittedRobot>> {
        let batch = HostBatch::new(&input);
        let [count, ..] = input.u.dims();
        let robots: Vec<Recorded<'_>> = (0..count).map(|robot| batch.robot(robot)).collect();
        let (instructions, law) = (InstructionSet::best(), Arc::new(self.law()));
        let fitted = law.most_likely(instructions, &robots, input.measurement_noise).into_iter();
        let robot = |numbers: Vec<f32>| -> FittedRobot {
            let law = Arc::clone(&law);
            Box::new(move |motion| law.torques(instructions, &numbers, motion))
        };
        Some(fitted.map(robot).collect())
    }

    fn begin(self, input: &ModelInput, seed: u64) -> Self {
        self.with_found_chain(input, seed)
    }

    fn kept(&self, extents: Extents) -> usize {
        let (points, width) = (self.points, self.numbers.count() + 1);
        // The combinations of a fit, the torques of each of them, which the loss squares, and arrays
        // in the shape of the torques.
        let of_loss = width * width + points * extents.joints * (width + KEPT_BY_LOSS);
        let of_features = (!self.has_links()).then(|| self.kept_by_features(points));
        of_features.unwrap_or_default() + of_loss
    }

    fn is_generative(&self) -> bool {
        true
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

/// Arrays in the shape of the torques that the loss keeps.
const KEPT_BY_LOSS: usize = 8;

/// The values of a tensor, with or without gradients.
fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.inner().into_data().iter().collect()
}

/// A parameter with other values.
fn with<const D: usize>(param: Param<Tensor<D>>, values: Vec<f32>) -> Param<Tensor<D>> {
    param.map(|tensor| {
        let data = TensorData::new(values, tensor.shape());
        Tensor::from_data(data, &tensor.device()).set_require_grad(tensor.is_require_grad())
    })
}
