//! Classical identification: an expert's fit of a model of the arm.

use dynamics::{Anchor, Joints, Motion, Replay, Robot};
use models::Interrupt;
use nalgebra::{Cholesky, DMatrix, DVector};
use series::Observed;
use spec::Integrator;

use super::NominalArm;
use super::constant_velocity::slope_at;
use super::continuation::{STRETCH_S, forgets_velocities, whole};
use super::end_state::end_state;
use super::filtered::{answer_with_arms, held};
use super::prior::{Arm, Freedom, Prior};
use crate::predictor::Answer;
use crate::{EvaluationError, Predictor};

/// Fits each robot's dynamic parameters by Gauss-Newton through the simulator of this project, to
/// the positions of the context. Then it simulates the horizon.
///
/// The estimate is the maximum a posteriori of these parameters ([`Prior`]). Every link has its
/// mass, the three coordinates of its centre and the stretch along its three axes, so that every
/// candidate is physical. Every joint has its damping and its velocity at the first sample. The
/// position there is the measured one. Armatures, friction, lengths and the payload are parameters
/// where the data's robots vary in them, and otherwise the nominal arm's.
///
/// Residuals are measured minus simulated positions, [`COMPARED_HZ`] times a second. The simulation
/// is set to the measured position at the end of the context and every [`STRETCH_S`] before it. It
/// keeps its velocity if damping soon forgets it, and is otherwise set to the slope of the measured
/// positions: an unknown load would drive the velocity of a lightly damped arm away. Such a slope has
/// an error of its own, which grows into all positions of its stretch, and [`Stretch::weigh`]
/// counts what it may explain for less. The horizon of
/// such an arm begins at [`end_state`] if all of it was fitted, because a wrong arm misleads that
/// filter. This is multiple shooting. Over longer stretches, an arm that gravity makes unstable depends too sharply on its parameters to be
/// fitted. The assumed noise of the residuals is their current size, at least [`NOISE`], so that
/// the prior keeps steps short far from the robot.
///
/// Derivatives are forward differences. The arm and its neighbours in every parameter are lanes of
/// one simulation, of order [`ORDER_OF_DERIVATIVES`] at most, because its errors are nearly the
/// same for all of them. The steps for all [`DAMPINGS`] (Levenberg and Marquardt) are lanes of one
/// simulation of full order, and the best step is taken. The fit ends when no step lowers the cost
/// by the share [`LEAST_DECREASE`], and after [`ITERATIONS`].
///
/// If the simulation of the fitted arm is not finite, the answer is that of the nominal arm. If
/// that is not finite either, the answer is the last position.
#[derive(Clone, Debug)]
pub struct Identification {
    prior: Prior,
    replay: Replay,
    /// The simulation for derivatives.
    coarse: Replay,
    /// Whether the nominal arm forgets velocities within a stretch.
    forgets: bool,
}

/// Parameters in standard deviations of the prior.
type Parameters = DVector<f64>;

/// Least standard deviation of measured from simulated positions, rad, about the resolution of
/// encoders. A smaller one would fit rounding errors, with twice the steps and no better
/// predictions.
const NOISE: f64 = 1e-4;
/// Rate at which positions are compared, Hz. At higher rates, neighbouring positions of slow arms
/// add no information.
const COMPARED_HZ: f64 = 15.0;
/// Variance of a velocity to which a simulation is set, in that of a compared position, 1/s².
const VELOCITY_VARIANCE: f64 = 100.0;
/// Root mean square of the change of positions that a forward difference aims at, rad. It is far
/// above rounding, and small enough to be linear.
const CHANGE: f64 = 1e-3;
/// Bounds of forward differences, in standard deviations of the prior.
const LEAST_DIFFERENCE: f64 = 1e-3;
/// The order of extrapolation. Order 2 takes 3 evaluations of the dynamics, and order 4 takes 10.
const ORDER_OF_DERIVATIVES: u32 = 2;
const LARGEST_DIFFERENCE: f64 = 0.3;
const ITERATIONS: usize = 20;
const LEAST_DECREASE: f64 = 0.03;
/// Factors of the curvature's diagonal that are added to it.
const DAMPINGS: [f64; 8] = [0.0, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 100.0];

impl Identification {
    /// Fits all parameters of the arm.
    pub fn new(arm: &NominalArm) -> Self {
        Self::with(arm, Freedom::Everything)
    }

    /// Fits nothing: the nominal arm. Its velocity at the end of the context follows from the
    /// context's torques.
    pub fn nothing(arm: &NominalArm) -> Self {
        Self::with(arm, Freedom::Nothing)
    }

    /// Fits only dampings.
    pub fn dampings(arm: &NominalArm) -> Self {
        Self::with(arm, Freedom::Dampings)
    }

    fn with(arm: &NominalArm, freedom: Freedom) -> Self {
        let NominalArm { robot, integrator, .. } = arm;
        let replay = arm.replay();
        let coarse = match *integrator {
            Integrator::Extrapolated { order, substeps } => {
                Integrator::Extrapolated { order: order.min(ORDER_OF_DERIVATIVES), substeps }
            }
            other => other,
        };
        Self {
            prior: Prior::new(robot, freedom),
            forgets: forgets_velocities(robot),
            coarse: Replay { integrator: coarse, ..replay },
            replay,
        }
    }

    /// The arm, and positions `[sample, joint]` of the horizon. It is fitted to the `observed`
    /// positions, from which noise was removed, and begins where the `measured` ones end.
    fn predict_one(
        &self,
        [observed, measured]: [&Observed<'_>; 2],
        scenario: usize,
        interrupt: &Interrupt,
    ) -> (Robot, Vec<f32>) {
        let joints = self.prior.joints();
        let torques = observed.u(scenario).values();
        let track = observed.y(scenario);
        let positions = track.values();
        let known = positions.len();
        let rate_hz = observed.rate_hz();
        let velocity = |sample: usize| {
            (!self.forgets)
                .then(|| Joints::from_fn(joints, |joint| slope_at(track, sample, joint, rate_hz)))
        };
        let anchors = anchors(positions, joints, whole(rate_hz * STRETCH_S), velocity);
        let stride = whole(rate_hz / COMPARED_HZ);
        let mut fit = Fit {
            arm: self,
            torques: &torques[..known],
            positions,
            start: Start::of(positions, joints, rate_hz),
            stretches: match self.forgets {
                true => Vec::new(),
                false => stretches(&anchors, known / joints, stride, rate_hz),
            },
            anchors,
            stride,
        };
        let fitted = fit.solve(interrupt);
        let nominal = Parameters::zeros(self.prior.parameters());
        let candidates = [fitted, nominal].map(|numbers| self.prior.arm_at(numbers.as_slice()));
        if !self.forgets && self.prior.freedom() == Freedom::Everything {
            let [fitted, _] = &candidates;
            let (u, y) = (measured.u(scenario), measured.y(scenario));
            let end = end_state(&fitted.robot, u, y, rate_hz, measured.noise());
            if let Some((anchor, end)) = fit.anchors.last_mut().zip(end) {
                (anchor.q, anchor.qd) = (end.q, Some(end.qd));
            }
        }
        let q = self.replay.run(&candidates.each_ref().map(|arm| fit.motion(arm, torques)));
        let is_finite = |(_, q): &(Arm, &[f32])| q.iter().all(|q| q.is_finite());
        let [fitted, nominal] = candidates;
        let mut simulated = [fitted, nominal].into_iter().zip(q.chunks_exact(torques.len()));
        match simulated.find(is_finite) {
            Some((arm, q)) => (arm.robot, q[known..].to_vec()),
            None => (self.prior.nominal().clone(), held(observed, scenario)),
        }
    }
}

/// The last measured position and every `stride`th position before it, with the velocities there if
/// `velocity` gives them.
fn anchors(
    positions: &[f32],
    joints: usize,
    stride: usize,
    velocity: impl Fn(usize) -> Option<Joints<f64>>,
) -> Vec<Anchor> {
    let measured = positions.chunks_exact(joints).enumerate().rev().step_by(stride);
    let anchor = |(sample, q): (usize, &[f32])| Anchor {
        sample,
        q: q.iter().copied().map(f64::from).collect(),
        qd: velocity(sample),
    };
    let mut anchors: Vec<Anchor> = measured.map(anchor).collect();
    anchors.reverse();
    anchors
}

/// Compared positions from one anchor to the next, whose errors are alike where the velocity at the
/// anchor is wrong.
struct Stretch {
    /// The index of the first of them among the compared ones, which begin with the last sample.
    first: usize,
    /// The times of each since the anchor, s.
    times_s: Vec<f64>,
}

impl Stretch {
    /// Makes the errors of a stretch, whose covariance is I + [`VELOCITY_VARIANCE`] t tᵀ in time t
    /// since the anchor, independent and of variance 1. `values` are errors `[sample, joint]`.
    fn weigh(&self, values: &mut [f64], joints: usize) {
        let square: f64 = self.times_s.iter().map(|time| time * time).sum();
        let share = (1.0 - 1.0 / (1.0 + VELOCITY_VARIANCE * square).sqrt()) / square;
        for joint in 0..joints {
            let at = |k: usize| (self.first + k) * joints + joint;
            let drift: f64 =
                self.times_s.iter().enumerate().map(|(k, time)| time * values[at(k)]).sum();
            for (k, time) in self.times_s.iter().enumerate() {
                values[at(k)] -= share * drift * time;
            }
        }
    }
}

/// The stretches of every `stride`th of so many samples, from the last one backwards.
fn stretches(anchors: &[Anchor], samples: usize, stride: usize, rate_hz: f64) -> Vec<Stretch> {
    let mut found: Vec<(usize, Stretch)> = Vec::new();
    for (index, sample) in (1..samples).rev().step_by(stride).enumerate() {
        let before = anchors.iter().rev().map(|anchor| anchor.sample);
        let from = before.into_iter().find(|anchor| *anchor < sample).unwrap_or(0);
        let time_s = (sample - from) as f64 / rate_hz;
        match found.last_mut() {
            Some((anchor, stretch)) if *anchor == from => stretch.times_s.push(time_s),
            _ => found.push((from, Stretch { first: index, times_s: vec![time_s] })),
        }
    }
    found.into_iter().map(|(_, stretch)| stretch).collect()
}

impl Predictor for Identification {
    fn name(&self) -> &'static str {
        match self.prior.freedom() {
            Freedom::Nothing => "nominal-simulator",
            Freedom::Dampings => "simulator-fitted-damping",
            Freedom::Everything => "identification",
        }
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        Ok(self.answer(observed, 1)?.positions)
    }

    fn answer(&self, observed: &Observed<'_>, _: usize) -> Result<Answer, EvaluationError> {
        answer_with_arms(observed, |asked, scenario, interrupt| {
            self.predict_one(asked, scenario, interrupt)
        })
    }
}

/// State at the first sample, with the velocities that follow from the positions.
struct Start {
    q: Joints<f64>,
    qd: Joints<f64>,
}

impl Start {
    fn of(positions: &[f32], joints: usize, rate_hz: f64) -> Self {
        let samples = positions.len() / joints;
        let at = |k: usize, joint: usize| f64::from(positions[k.min(samples - 1) * joints + joint]);
        Self {
            q: Joints::from_fn(joints, |joint| at(0, joint)),
            // The slope of the parabola through three samples.
            qd: Joints::from_fn(joints, |joint| {
                0.5 * rate_hz * (4.0 * at(1, joint) - 3.0 * at(0, joint) - at(2, joint))
            }),
        }
    }
}

/// Candidate parameters with their residuals and cost.
struct Candidate {
    parameters: Parameters,
    residuals: DVector<f64>,
    cost: f64,
}

/// The estimation for one scenario.
struct Fit<'a> {
    arm: &'a Identification,
    /// `[sample, joint]` of the context, like the positions.
    torques: &'a [f32],
    positions: &'a [f32],
    start: Start,
    anchors: Vec<Anchor>,
    /// Samples between two compared positions.
    stride: usize,
    /// The stretches whose first velocities are slopes.
    stretches: Vec<Stretch>,
}

impl Fit<'_> {
    /// Iterates to the end. Gives zeros, the nominal arm, if that cannot be simulated.
    fn solve(&self, interrupt: &Interrupt) -> Parameters {
        let parameters = self.arm.prior.parameters();
        let mut estimate = Parameters::zeros(parameters);
        if parameters == 0 {
            return estimate;
        }
        let mut differences = vec![LARGEST_DIFFERENCE / 10.0; parameters];
        let simulated = self.simulate(&self.arm.replay, std::slice::from_ref(&estimate));
        let mut residuals = self.residuals(&simulated);
        for _ in 0..ITERATIONS {
            interrupt.leave_if_raised();
            let Some(jacobian) = self.jacobian(&estimate, &differences) else { break };
            for (difference, row) in differences.iter_mut().zip(jacobian.row_iter()) {
                let change = row.norm() / (residuals.len() as f64).sqrt();
                *difference = (CHANGE / change).clamp(LEAST_DIFFERENCE, LARGEST_DIFFERENCE);
            }
            let squares = residuals.norm_squared();
            let noise = NOISE.max((squares / residuals.len() as f64).sqrt());
            let weight = 1.0 / (noise * noise);
            let curvature = &jacobian * jacobian.transpose() * weight
                + DMatrix::<f64>::identity(parameters, parameters);
            let downhill = &jacobian * &residuals * weight - &estimate;
            let cost = squares * weight + estimate.norm_squared();
            let steps = DAMPINGS.iter().filter_map(|damping| {
                let mut damped = curvature.clone();
                for k in 0..parameters {
                    damped[(k, k)] *= 1.0 + damping;
                }
                Some(&estimate + Cholesky::new(damped)?.solve(&downhill))
            });
            let Some(best) = self.cheapest(steps.collect(), weight) else { break };
            let is_enough = best.cost > cost * (1.0 - LEAST_DECREASE);
            if best.cost < cost {
                (estimate, residuals) = (best.parameters, best.residuals);
            }
            if is_enough {
                break;
            }
        }
        estimate
    }

    /// The change of the simulated positions, `[parameter, residual]`. `None` if a simulation
    /// diverges.
    fn jacobian(&self, at: &Parameters, differences: &[f64]) -> Option<DMatrix<f64>> {
        let parameters = differences.len();
        let neighbours = (0..parameters).map(|k| {
            let mut neighbour = at.clone();
            neighbour[k] += differences[k];
            neighbour
        });
        let robots: Vec<Parameters> = std::iter::once(at.clone()).chain(neighbours).collect();
        let simulated = self.simulate(&self.arm.coarse, &robots);
        if simulated.iter().any(|q| !q.is_finite()) {
            return None;
        }
        let (center, neighbours) = simulated.split_at(self.positions.len());
        let mut jacobian = DMatrix::zeros(parameters, self.kept(center).count());
        for (parameter, neighbour) in neighbours.chunks_exact(self.positions.len()).enumerate() {
            let both = self.kept(neighbour).zip(self.kept(center));
            let slopes = both.map(|(ahead, behind)| (ahead - behind) / differences[parameter]);
            jacobian.set_row(parameter, &self.weighed(slopes).transpose());
        }
        Some(jacobian)
    }

    /// The candidate of least cost. `None` if no cost is finite.
    fn cheapest(&self, candidates: Vec<Parameters>, weight: f64) -> Option<Candidate> {
        let simulated = self.simulate(&self.arm.replay, &candidates);
        candidates
            .into_iter()
            .zip(simulated.chunks_exact(self.positions.len()))
            .map(|(parameters, q)| {
                let residuals = self.residuals(q);
                let cost = residuals.norm_squared() * weight + parameters.norm_squared();
                Candidate { parameters, residuals, cost }
            })
            .filter(|candidate| candidate.cost.is_finite())
            .min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// Measured minus simulated positions.
    fn residuals(&self, simulated: &[f32]) -> DVector<f64> {
        let pairs = self.kept(self.positions).zip(self.kept(simulated));
        self.weighed(pairs.map(|(y, q)| y - q))
    }

    /// Errors of the compared positions, without what wrong velocities at anchors make alike.
    fn weighed(&self, errors: impl Iterator<Item = f64>) -> DVector<f64> {
        let mut errors: Vec<f64> = errors.collect();
        for stretch in &self.stretches {
            stretch.weigh(&mut errors, self.arm.prior.joints());
        }
        DVector::from_vec(errors)
    }

    /// The compared positions: the last sample and every [`Fit::stride`]th one before it.
    fn kept<'q>(&self, positions: &'q [f32]) -> impl Iterator<Item = f64> + use<'q> {
        let samples = positions.chunks_exact(self.arm.prior.joints());
        samples.rev().step_by(self.stride).flatten().map(|q| f64::from(*q))
    }

    /// Positions `[robot, sample, joint]` over the context.
    fn simulate(&self, replay: &Replay, robots: &[Parameters]) -> Vec<f32> {
        let prior = &self.arm.prior;
        let arms: Vec<Arm> =
            robots.iter().map(|numbers| prior.arm_at(numbers.as_slice())).collect();
        let motions: Vec<Motion<'_>> =
            arms.iter().map(|arm| self.motion(arm, self.torques)).collect();
        replay.run(&motions)
    }

    fn motion<'m>(&'m self, arm: &'m Arm, u: &'m [f32]) -> Motion<'m> {
        let Start { q, qd } = &self.start;
        let qd0 = Joints::from_fn(qd.len(), |joint| qd[joint] + arm.extra_velocity[joint]);
        Motion { robot: &arm.robot, q0: *q, qd0, u, anchors: &self.anchors }
    }
}
