//! Forecasts that controllers use.

use dynamics::{ArmState, Joints, Motion, Replay, Robot};
use series::{Series, Shape};
use spec::{ControlBaseline, SimulateSpec};

use crate::baselines::to_f32;
use crate::{DampedIntegrator, EvaluationError, Predictor};

/// The knowledge at the moment of planning.
#[derive(Clone, Copy, Debug)]
pub struct Now<'a> {
    /// Torques so far, N·m.
    pub u: &'a [Joints<f32>],
    /// Positions so far, rad. There is one more than torques, and the last one is the present
    /// position.
    pub y: &'a [Joints<f32>],
    /// The true state with velocities, which only simulators use.
    pub state: &'a ArmState,
}

/// Predicts the positions that torques lead to.
pub trait Forecast {
    /// Positions `[plan, step]` (rad) after each torque of `plans` `[plan, step]` (N·m). Each plan
    /// has `steps` torques.
    ///
    /// # Errors
    /// There is no answer. Single plans may have positions that are not finite.
    fn foresee(
        &self,
        now: &Now<'_>,
        plans: &[Joints<f32>],
        steps: usize,
    ) -> Result<Vec<Joints<f32>>, EvaluationError>;
}

/// One of the compared controllers.
pub struct Controller<'a> {
    /// Name of the model.
    pub name: String,
    /// The forecast. With `None` no torque acts.
    pub forecast: Option<Box<dyn Forecast + 'a>>,
}

impl Controller<'_> {
    /// The controller of `baseline`, for `robot`.
    pub fn baseline(baseline: ControlBaseline, simulation: &SimulateSpec, robot: &Robot) -> Self {
        let replay = Replay::of(simulation);
        let forecast: Option<Box<dyn Forecast>> = match baseline {
            // Specs refuse the last one, which does not plan.
            ControlBaseline::ZeroTorque | ControlBaseline::Identification => None,
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

/// A simulator of an arm that starts from the true state. Plans are its lanes.
#[derive(Clone, Debug)]
pub struct Simulated {
    /// The robot whose motion is forecast.
    pub robot: Robot,
    /// How it is simulated.
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

/// A forecast by a predictor, from the latest samples and the torques of a plan.
pub struct Foreseen<P> {
    /// The predictor that is asked.
    pub predictor: P,
    /// Samples of the predictor's context.
    pub context: usize,
    /// Samples of the predictor's horizon. `None` if it can be as long as a plan. The last torques
    /// of a plan are held after its end.
    pub horizon: Option<usize>,
    /// Samples per second.
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
        // The context ends with the present sample. The first torque of a plan belongs to this
        // sample.
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
