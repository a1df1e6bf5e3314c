//! Trials of controllers on one robot.

use std::ops::ControlFlow;
use std::time::Instant;

use dynamics::Joints;
use serde::{Deserialize, Serialize};
use series::Series;
use spec::{ControlSpec, SimulateSpec};
use wire::Warning;

use super::forecast::{Controller, Forecast};
use super::mppi::{self, Key};
use super::plant::Plant;
use super::reference::Reference;
use super::tracking::{Judge, Tracking, excited_nm};
use crate::EvaluationError;
use crate::baselines::to_f32;

/// The task of all controllers.
#[derive(Clone, Debug)]
pub struct Experiment<'a> {
    spec: &'a ControlSpec,
    simulation: &'a SimulateSpec,
    judge: Judge,
}

/// All trials of one robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RobotTrials {
    /// Index of the robot's trajectory in the simulation.
    pub robot: u64,
    /// Joints of the arm.
    pub joints: usize,
    /// Number of threads that computed.
    pub threads: usize,
    /// The trials, one per controller.
    pub trials: Vec<Trial>,
    /// Ranges of the motions that lie outside of those of the checkpoints' trainings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// One controller on one robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Name of the controller.
    pub controller: String,
    /// `None` if the controller failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracking: Option<Tracking>,
    /// Why the trial ended early.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
    /// Root mean square over joints in degrees, at each sample from the first one after a torque.
    /// It ends where the controller failed.
    pub error_deg: Vec<f64>,
    /// Time that each plan took, ms.
    pub plan_ms: Vec<f64>,
}

/// The recording of the robot during control.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// Torques of control, N·m.
    pub torques: Vec<Joints<f32>>,
    /// Positions after each torque, rad.
    pub positions: Vec<Joints<f32>>,
    /// Positions of the path, rad.
    pub path: Vec<Joints<f64>>,
}

/// The trial of a controller on a robot, with its recordings.
#[derive(Clone, Debug)]
pub struct Ran {
    /// How it went.
    pub trial: Trial,
    /// The recording of control.
    pub trace: Trace,
    /// Torques and positions from the beginning of the excitation on. `None` if some are not finite.
    pub recorded: Option<Series>,
}

impl<'a> Experiment<'a> {
    /// The experiment of a `spec` that was checked to fit `simulation`.
    pub fn new(spec: &'a ControlSpec, simulation: &'a SimulateSpec) -> Self {
        let judge = Judge::new(simulation, excited_nm(simulation));
        Self { spec, simulation, judge }
    }

    /// The robot of trajectory `index` at the beginning of control.
    ///
    /// # Errors
    /// Those of [`dynamics::simulate`].
    pub fn plant(&self, index: u64) -> Result<Plant, dynamics::DynamicsError> {
        Plant::excited(self.simulation, index, self.spec.context as usize)
    }

    /// Samples of control.
    pub fn steps(&self) -> u32 {
        self.spec.steps(self.simulation.rate_hz)
    }

    /// Lets a controller control the robot of trajectory `index`. `progress` gets the number of
    /// finished samples. If it breaks, the trial ends without a result.
    pub fn run(
        &self,
        index: u64,
        mut plant: Plant,
        controller: &Controller<'_>,
        progress: &dyn Fn(u32) -> ControlFlow<()>,
    ) -> Option<Ran> {
        let begin = plant.now().u.len();
        let steps = self.steps() as usize;
        let reference = Reference::new(&self.spec.path, plant.state().q, self.judge.limits_rad());
        // The path after `step` samples of control.
        let path = |step: usize| reference.at(step as f64 / self.simulation.rate_hz);
        let horizon = self.spec.planner.horizon as usize;
        let mut plan = vec![Joints::splat(self.simulation.joints(), 0.0); horizon];
        let mut plan_ms = Vec::new();
        let mut failure = None;
        let mut step = 0;
        while step < steps && failure.is_none() {
            if progress(u32::try_from(step).unwrap_or(u32::MAX)).is_break() {
                return None;
            }
            let count = (self.spec.planner.replan_every as usize).min(steps - step);
            if let Some(forecast) = &controller.forecast {
                let ahead: Vec<_> = (1..=horizon).map(|after| path(step + after)).collect();
                let key = Key { seed: self.spec.seed, robot: index, step: step as u64 };
                let started = Instant::now();
                let made = self.plan(key, forecast.as_ref(), &plant, &mut plan, &ahead);
                plan_ms.push(started.elapsed().as_secs_f64() * 1e3);
                if let Err(error) = made {
                    failure = Some(describe(&error, step));
                    break;
                }
            }
            let torques: Vec<_> = plan[..count].iter().map(|torques| torques.map(to_f32)).collect();
            plant.apply(&torques);
            step += count;
            if !plant.is_finite() {
                failure = Some(format!("the robot's state is not finite at sample {step}"));
            }
            advance(&mut plan, count);
        }
        let trace = Trace {
            torques: plant.now().u[begin..].to_vec(),
            positions: plant.now().y[begin + 1..].to_vec(),
            path: (1..=step).map(path).collect(),
        };
        let trial = Trial {
            controller: controller.name.clone(),
            tracking: failure.is_none().then(|| self.judge.tracking(&trace)),
            failure,
            error_deg: trace.errors_deg().take_while(|error| error.is_finite()).collect(),
            plan_ms,
        };
        let recorded = plant.recorded(self.simulation.rate_hz);
        Some(Ran { trial, trace, recorded })
    }

    fn plan(
        &self,
        key: Key,
        forecast: &dyn Forecast,
        plant: &Plant,
        plan: &mut [Joints<f64>],
        ahead: &[Joints<f64>],
    ) -> Result<(), EvaluationError> {
        let now = plant.now();
        let steps = plan.len();
        let joints = &self.simulation.robot.description().joints;
        let limits_nm = joints.iter().map(|joint| joint.torque_nm).collect();
        mppi::improve(&self.spec.planner, &limits_nm, key, plan, ahead, |plans| {
            forecast.foresee(&now, plans, steps)
        })
    }
}

impl Trace {
    /// Root mean square of positions minus the path over joints, at each sample, degrees.
    pub(super) fn errors_deg(&self) -> impl Iterator<Item = f64> {
        self.errors().map(|errors| rms(&errors).to_degrees())
    }

    /// Positions minus the path, rad.
    pub(super) fn errors(&self) -> impl Iterator<Item = Joints<f64>> {
        self.positions.iter().zip(&self.path).map(|(positions, path)| {
            Joints::from_fn(path.len(), |joint| f64::from(positions[joint]) - path[joint])
        })
    }
}

/// Drops the first `count` samples of a plan. Its last torques are held.
fn advance(plan: &mut [Joints<f64>], count: usize) {
    let last = plan[plan.len() - 1];
    plan.rotate_left(count);
    let left = plan.len() - count;
    plan[left..].fill(last);
}

pub(super) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

fn describe(error: &EvaluationError, step: usize) -> String {
    let source = std::error::Error::source(error).map(|source| format!(": {source}"));
    format!("at sample {step}: {error}{}", source.unwrap_or_default())
}
