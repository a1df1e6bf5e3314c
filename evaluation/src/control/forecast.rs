//! What controllers foresee.

use dynamics::{ArmState, Joints, Motion, Replay, Robot};
use series::{Series, Shape};
use spec::{ControlBaseline, SimulateSpec};

use crate::baselines::to_f32;
use crate::{DampedIntegrator, EvaluationError, Predictor};

/// Everything that is known when a plan is made.
#[derive(Clone, Copy, Debug)]
pub struct Now<'a> {
    /// Torques that acted so far, N·m.
    pub u: &'a [Joints<f32>],
    /// Positions so far, rad: one more than torques, the last of which is now.
    pub y: &'a [Joints<f32>],
    /// The true state, velocities included, which only simulators make use of.
    pub state: &'a ArmState,
}

/// Says where torques would lead.
pub trait Forecast {
    /// Positions `[plan, step]` (rad) after each torque of `plans` `[plan, step]` (N·m), of which each
    /// has `steps`.
    ///
    /// # Errors
    /// When there is no answer at all; single ones may have values that are not finite.
    fn foresee(
        &self,
        now: &Now<'_>,
        plans: &[Joints<f32>],
        steps: usize,
    ) -> Result<Vec<Joints<f32>>, EvaluationError>;
}

/// One of those that are compared.
pub struct Controller<'a> {
    pub name: String,
    /// `None` lets no torque act.
    pub forecast: Option<Box<dyn Forecast + 'a>>,
}

impl Controller<'_> {
    /// The controller that `baseline` names, for `robot`.
    pub fn baseline(baseline: ControlBaseline, simulation: &SimulateSpec, robot: &Robot) -> Self {
        let replay = Replay::of(simulation);
        let forecast: Option<Box<dyn Forecast>> = match baseline {
            ControlBaseline::ZeroTorque => None,
            ControlBaseline::DampedIntegrator => {
                let damping_nm_s_rad = simulation.robot.damping_nm_s_rad.clone();
                let predictor = DampedIntegrator { damping_nm_s_rad };
                let rate_hz = simulation.rate_hz;
                Some(Box::new(Foreseen { predictor, context: 1, horizon: None, rate_hz }))
            }
            ControlBaseline::NominalSimulator => {
                Some(Box::new(Simulated { robot: Robot::nominal(&simulation.robot), replay }))
            }
            ControlBaseline::Oracle => Some(Box::new(Simulated { robot: robot.clone(), replay })),
        };
        Controller { name: baseline.as_str().to_owned(), forecast }
    }
}

/// A simulator of an arm, from the true state; plans are its lanes.
#[derive(Clone, Debug)]
pub struct Simulated {
    pub robot: Robot,
    pub replay: Replay,
}

impl Forecast for Simulated {
    fn foresee(
        &self,
        now: &Now<'_>,
        plans: &[Joints<f32>],
        steps: usize,
    ) -> Result<Vec<Joints<f32>>, EvaluationError> {
        let ArmState { q: q0, qd: qd0 } = *now.state;
        let joints = self.robot.joints();
        let u: Vec<f32> = plans.iter().flatten().copied().collect();
        let motion = |u| Motion { robot: &self.robot, q0, qd0, u, anchors: &[] };
        let motions: Vec<Motion<'_>> = u.chunks_exact(steps * joints).map(motion).collect();
        let (positions, ends) = self.replay.run_through(&motions);
        let after =
            positions.chunks_exact(steps * joints).zip(ends).flat_map(|(positions, end)| {
                let later = positions.chunks_exact(joints).skip(1).map(Joints::from);
                later.chain([end.q.map(to_f32)])
            });
        Ok(after.collect())
    }
}

/// A predictor, asked about the latest samples and what would come next.
pub struct Foreseen<P> {
    pub predictor: P,
    /// Samples it is given.
    pub context: usize,
    /// Samples it has to be asked for; `None` if as many as a plan has. The torques after a plan are its
    /// last ones.
    pub horizon: Option<usize>,
    pub rate_hz: f64,
}

impl<P: Predictor> Forecast for Foreseen<P> {
    fn foresee(
        &self,
        now: &Now<'_>,
        plans: &[Joints<f32>],
        steps: usize,
    ) -> Result<Vec<Joints<f32>>, EvaluationError> {
        let horizon = self.horizon.unwrap_or(steps).max(steps);
        // The context ends now, and the first torque of a plan is that of its last sample.
        let past = &now.u[now.u.len() - (self.context - 1)..];
        let known = &now.y[now.y.len() - self.context..];
        let joints = known[0].len();
        let plans = plans.chunks_exact(steps);
        let samples = self.context + horizon;
        let shape = Shape { robots: plans.len(), samples, joints };
        let mut u = Vec::with_capacity(shape.values()?);
        let mut y = Vec::with_capacity(shape.robots * self.context * joints);
        for plan in plans {
            let held = std::iter::repeat_n(&plan[steps - 1], horizon + 1 - steps);
            u.extend(past.iter().chain(plan).chain(held).flatten());
            y.extend(known.iter().flatten());
        }
        let expected = shape.robots * horizon * joints;
        let question = Series::question(shape, self.context, self.rate_hz, u, y)?;
        let predicted = self.predictor.predict(&question.observed(self.context))?;
        if predicted.len() != expected {
            let predictor = self.predictor.name().to_owned();
            return Err(EvaluationError::WrongLength { predictor, got: predicted.len(), expected });
        }
        let rows = predicted.chunks_exact(horizon * joints);
        let planned = rows.flat_map(|row| row[..steps * joints].chunks_exact(joints));
        Ok(planned.map(Joints::from).collect())
    }
}
