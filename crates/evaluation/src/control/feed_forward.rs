//! Robots that go on along the references of their own controllers. Each predictor adds the torques
//! that it expects the motion to take.

use std::ops::ControlFlow;
use std::time::Instant;

use dynamics::{
    DynamicsError, Excitation, Joints, ReferenceState, Robot, Scenario, Scenarios, inverse_dynamics,
};
use models::TrainedModel;
use series::{JointMotion, Observed, Series};
use spec::{Baseline, ControlBaseline, ControlSpec, SimulateSpec};

use super::tracking::{Judge, commanded_nm};
use super::trial::{Ran, Trace, Trial};
use crate::baselines::to_f32;
use crate::{EvaluationError, NominalArm, baseline};

/// The task of all feed-forwards.
pub struct Pursuit<'a> {
    spec: &'a ControlSpec,
    simulation: &'a SimulateSpec,
    source: Scenarios<'a>,
    judge: Judge,
}

/// The motion of a robot under its controller alone.
#[derive(Clone, Debug)]
pub struct Pursued {
    scenario: Scenario,
    series: Series,
    /// References of the controlled part, one for each control period.
    states: Vec<ReferenceState>,
    motion: JointMotion,
}

impl Pursued {
    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.scenario.robot
    }
}

/// The torques of one predictor.
pub struct FeedForward<'a> {
    /// Name of the predictor.
    pub name: String,
    /// Where its torques come from.
    pub torques: ExpectedTorques<'a>,
}

/// The torques that a predictor expects a motion to take.
pub enum ExpectedTorques<'a> {
    /// None beside those of the robot's own controller.
    OfController,
    /// Those of the controller, and D q̇, with D in N·m·s/rad.
    Damping(Vec<f64>),
    /// Those of an arm.
    OfArm(Box<Robot>),
    /// Those that a predictor says, `[instant, joint]`, N·m, from the samples before control.
    Said(Box<SayTorques<'a>>),
}

/// Says the torques of a motion.
pub type SayTorques<'a> =
    dyn Fn(&Observed<'_>, &JointMotion) -> Result<Vec<f64>, EvaluationError> + 'a;

impl<'a> FeedForward<'a> {
    /// The feed-forward of `name`, for `robot`.
    pub fn baseline(name: ControlBaseline, simulation: &SimulateSpec, robot: &Robot) -> Self {
        let torques = match name {
            ControlBaseline::ZeroTorque => ExpectedTorques::OfController,
            ControlBaseline::DampedIntegrator => {
                ExpectedTorques::Damping(simulation.robot.damping_nm_s_rad.clone())
            }
            ControlBaseline::NominalSimulator => {
                ExpectedTorques::OfArm(Box::new(Robot::nominal(&simulation.robot)))
            }
            ControlBaseline::Identification => {
                let predictor =
                    baseline(Baseline::Identification, &NominalArm::of_simulation(simulation));
                ExpectedTorques::Said(Box::new(move |observed, motion| {
                    let answer = predictor.answer(observed, 1)?;
                    let motions = std::slice::from_ref(motion);
                    only(predictor.name(), predictor.torques(observed, &answer, motions)?)
                }))
            }
            ControlBaseline::Oracle => ExpectedTorques::OfArm(Box::new(robot.clone())),
        };
        Self { name: name.as_str().to_owned(), torques }
    }

    /// The feed-forward of a checkpoint.
    pub fn learned(name: &str, model: &'a TrainedModel) -> Self {
        let predictor = name.to_owned();
        let say = move |observed: &Observed<'_>, motion: &JointMotion| {
            let said = model.torques(observed, std::slice::from_ref(motion));
            let said = said.map_err(|source| EvaluationError::Model {
                predictor: predictor.clone(),
                source,
            })?;
            let widened = only(&predictor, said)?;
            Ok(widened.into_iter().map(f64::from).collect())
        };
        Self { name: name.to_owned(), torques: ExpectedTorques::Said(Box::new(say)) }
    }
}

/// The torques of the only robot.
fn only<T>(predictor: &str, said: Option<Vec<Vec<T>>>) -> Result<Vec<T>, EvaluationError> {
    let torques = said.and_then(|mut robots| robots.pop());
    torques.ok_or_else(|| EvaluationError::SaysNoTorques { predictor: predictor.to_owned() })
}

impl<'a> Pursuit<'a> {
    /// The task of a `spec` that was checked to fit `simulation`, whose robots have controllers.
    ///
    /// # Errors
    /// Those of [`dynamics::simulate`].
    pub fn new(spec: &'a ControlSpec, simulation: &'a SimulateSpec) -> Result<Self, DynamicsError> {
        let judge = Judge::new(simulation, commanded_nm(simulation)?);
        Ok(Self { spec, simulation, source: Scenarios::new(simulation), judge })
    }

    /// Samples of control.
    pub fn steps(&self) -> u32 {
        self.spec.steps(self.simulation.rate_hz)
    }

    /// The robot of trajectory `index` with its motion in the data.
    ///
    /// # Errors
    /// Those of [`dynamics::simulate`].
    pub fn pursued(&self, index: u64) -> Result<Pursued, EvaluationError> {
        let go_on = |_| ControlFlow::Continue(());
        let mut recorded = dynamics::simulate(self.simulation, index..index + 1, &go_on)?;
        let scenario = recorded.scenarios.remove(0);
        let states = self.source.references(&scenario, self.spec.context).unwrap_or_default();
        let of = |value: fn(&ReferenceState) -> Joints<f64>| -> Vec<f64> {
            states.iter().flat_map(|state| value(state).to_vec()).collect()
        };
        let joints = self.simulation.joints();
        let motion = JointMotion::new(
            joints,
            of(|state| state.r),
            of(|state| state.rd),
            of(|state| state.rdd),
        )?;
        Ok(Pursued { scenario, series: recorded.series, states, motion })
    }

    /// Lets the robot follow its reference with the torques of a predictor.
    pub fn run(&self, pursued: &Pursued, feed_forward: &FeedForward<'_>) -> Ran {
        let started = Instant::now();
        let added = self.added_nm(pursued, &feed_forward.torques);
        let plan_ms = vec![started.elapsed().as_secs_f64() * 1e3];
        let moved = added.and_then(|added| self.moved(pursued, added));
        let name = feed_forward.name.clone();
        let (trace, recorded) = match moved {
            Ok(moved) => moved,
            Err(error) => {
                let trial = Trial {
                    controller: name,
                    tracking: None,
                    failure: Some(spec::causes(&error)),
                    error_deg: Vec::new(),
                    plan_ms,
                };
                return Ran { trial, trace: Trace::default(), recorded: None };
            }
        };
        let trial = Trial {
            controller: name,
            tracking: Some(self.judge.tracking(&trace)),
            failure: None,
            error_deg: trace.errors_deg().collect(),
            plan_ms,
        };
        Ran { trial, trace, recorded: Some(recorded) }
    }

    /// The torques that a predictor adds to those of the controller, `[control period, joint]`, from
    /// the first recorded sample on.
    fn added_nm(
        &self,
        pursued: &Pursued,
        torques: &ExpectedTorques<'_>,
    ) -> Result<Vec<f32>, EvaluationError> {
        let joints = self.simulation.joints();
        let own = |state: &ReferenceState| {
            let own = self.source.torques_on_reference(state);
            own.unwrap_or_else(|| Joints::splat(joints, 0.0))
        };
        let added: Vec<f64> = match torques {
            ExpectedTorques::OfController => return Ok(Vec::new()),
            ExpectedTorques::Damping(damping) => {
                let of_state = |state: &ReferenceState| {
                    let damped = damping.iter().zip(&state.rd).map(|(damping, rd)| damping * rd);
                    damped.collect::<Vec<f64>>()
                };
                pursued.states.iter().flat_map(of_state).collect()
            }
            ExpectedTorques::OfArm(arm) => {
                let of_state = |state: &ReferenceState| {
                    let taken = inverse_dynamics(arm, state.r, state.rd, state.rdd);
                    let own = own(state);
                    (0..joints).map(move |joint| taken[joint] - own[joint])
                };
                pursued.states.iter().flat_map(of_state).collect()
            }
            ExpectedTorques::Said(say) => {
                let observed = pursued.series.observed(self.spec.context as usize);
                let said = say(&observed, &pursued.motion)?;
                let rows = said.chunks_exact(joints).zip(&pursued.states);
                let of_row = |(said, state): (&[f64], &ReferenceState)| {
                    let own = own(state);
                    let added = said.iter().zip(&own).map(|(said, own)| said - own);
                    added.collect::<Vec<f64>>()
                };
                rows.flat_map(of_row).collect()
            }
        };
        let before = self.spec.context as usize * self.periods() * joints;
        Ok(std::iter::repeat_n(0.0, before).chain(added).map(to_f32).collect())
    }

    /// Control periods of a sampling period.
    fn periods(&self) -> usize {
        let controller = self.simulation.controller.as_ref();
        controller.map_or(1, |controller| controller.periods(self.simulation.rate_hz))
    }

    /// The time from the start of the motion to the beginning of control, s.
    fn before_s(&self) -> f64 {
        let rate_hz = self.simulation.rate_hz;
        let controller = self.simulation.controller.as_ref();
        let settling = controller.map_or(0, |controller| controller.settling_samples(rate_hz));
        (settling + self.spec.context as usize) as f64 / rate_hz
    }

    /// The motion with added torques.
    fn moved(
        &self,
        pursued: &Pursued,
        added_nm: Vec<f32>,
    ) -> Result<(Trace, Series), EvaluationError> {
        let mut scenario = pursued.scenario.clone();
        if let Excitation::ClosedLoop(tracking) = &mut scenario.excitation {
            tracking.added_nm = added_nm;
        }
        let (context, steps) = (self.spec.context as usize, self.steps() as usize);
        let mut longer = self.simulation.clone();
        // A position after the last torque.
        longer.samples = self.spec.context + self.steps() + 1;
        let moved = dynamics::simulate_scenarios(&longer, &[scenario]).map_err(|error| {
            let DynamicsError::NoDrawTracked { lost, joint, off_rad, time_s, .. } = error else {
                return EvaluationError::from(error);
            };
            EvaluationError::LostReference {
                lost,
                joint,
                off_rad,
                after_s: time_s - self.before_s(),
            }
        })?;
        let joints = self.simulation.joints();
        let rows = |values: &[f32], first: usize| -> Vec<Joints<f32>> {
            values[first * joints..][..steps * joints]
                .chunks_exact(joints)
                .map(Joints::from)
                .collect()
        };
        let reference = moved.reference.as_deref().unwrap_or_default();
        let trace = Trace {
            torques: rows(moved.series.true_u(), context),
            positions: rows(moved.series.true_y(), context + 1),
            path: rows(reference, context + 1)
                .into_iter()
                .map(|r| r.iter().map(|r| f64::from(*r)).collect())
                .collect(),
        };
        Ok((trace, moved.series))
    }
}
