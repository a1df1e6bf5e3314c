//! Trials of controllers on one robot.

use std::ops::ControlFlow;
use std::time::Instant;

use dynamics::{Joints, Scenarios};
use serde::{Deserialize, Serialize};
use series::{Series, Shape};
use spec::{ControlSpec, Range, SimulateSpec};
use wire::Warning;

use super::forecast::{Controller, Forecast};
use super::mppi::{self, Key};
use super::plant::Plant;
use super::reference::Reference;
use crate::EvaluationError;
use crate::baselines::to_f32;

/// The task of all controllers.
#[derive(Clone, Debug)]
pub struct Experiment<'a> {
    spec: &'a ControlSpec,
    simulation: &'a SimulateSpec,
    /// For each joint, the 99th percentile of the excitation's absolute torques, N·m.
    excited_nm: Joints<f64>,
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

/// How well a robot followed its path, and with which torques.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tracking {
    /// Mean over joints of `joint_rms_deg`.
    pub rms_deg: f64,
    /// Root mean square over time.
    pub joint_rms_deg: Vec<f64>,
    /// The largest error of any joint.
    pub peak_deg: f64,
    /// Root mean square over time and joints.
    pub torque_rms_nm: f64,
    /// Share of torques above the 99th percentile of the same joint's torques in the excitation.
    pub beyond_excitation: f64,
    /// Least distance of a joint to one of its limits, rad. It is negative beyond a limit, since
    /// the simulated arm has no stops.
    pub clearance_rad: f64,
}

/// The recording of the robot during control.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Torques of control, N·m.
    pub torques: Vec<Joints<f32>>,
    /// Positions after each torque, rad.
    pub positions: Vec<Joints<f32>>,
    /// Positions of the path, rad.
    pub path: Vec<Joints<f64>>,
}

impl<'a> Experiment<'a> {
    /// The experiment of a `spec` that was checked to fit `simulation`.
    pub fn new(spec: &'a ControlSpec, simulation: &'a SimulateSpec) -> Self {
        Self { spec, simulation, excited_nm: excited_nm(simulation) }
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
    ) -> Option<(Trial, Trace)> {
        let begin = plant.now().u.len();
        let steps = self.steps() as usize;
        let reference = Reference::new(&self.spec.path, plant.state().q, &self.limits_rad());
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
            tracking: failure.is_none().then(|| self.tracking(&trace)),
            failure,
            error_deg: trace
                .errors()
                .map(|errors| rms(&errors).to_degrees())
                .take_while(|error| error.is_finite())
                .collect(),
            plan_ms,
        };
        Some((trial, trace))
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

    fn limits_rad(&self) -> Vec<Range> {
        self.simulation.robot.description().per_joint(|joint| joint.position_rad)
    }

    fn tracking(&self, trace: &Trace) -> Tracking {
        let errors: Vec<Joints<f64>> = trace.errors().collect();
        let joints = self.simulation.joints();
        let joint_rms_deg = (0..joints).map(|joint| {
            let of_joint: Vec<f64> = errors.iter().map(|errors| errors[joint]).collect();
            rms(&of_joint).to_degrees()
        });
        let joint_rms_deg: Vec<f64> = joint_rms_deg.collect();
        let torques: Vec<f64> = trace.torques.iter().flatten().map(|&u| u.into()).collect();
        let beyond = trace.torques.iter().flat_map(|torques| torques.iter().zip(&self.excited_nm));
        let beyond = beyond.filter(|(u, excited)| f64::from(u.abs()) > **excited).count();
        let limits = self.limits_rad();
        let clearance = trace.positions.iter().flat_map(|positions| {
            positions.iter().zip(&limits).map(|(&q, limits)| {
                let q = f64::from(q);
                (q - limits.min).min(limits.max - q)
            })
        });
        Tracking {
            rms_deg: joint_rms_deg.iter().sum::<f64>() / joints as f64,
            joint_rms_deg,
            peak_deg: errors.iter().flatten().map(|e| e.abs()).fold(0.0, f64::max).to_degrees(),
            torque_rms_nm: rms(&torques),
            beyond_excitation: beyond as f64 / torques.len() as f64,
            clearance_rad: clearance.fold(f64::INFINITY, f64::min),
        }
    }
}

impl Trace {
    /// The torques and positions since the excitation of `plant`. `None` if some are not finite.
    pub fn recorded_after(&self, plant: &Plant, rate_hz: f64) -> Option<Series> {
        let before = plant.now();
        let u: Vec<f32> = before.u.iter().chain(&self.torques).flatten().copied().collect();
        let mut y: Vec<f32> = before.y.iter().chain(&self.positions).flatten().copied().collect();
        // There is one position more than torques.
        y.truncate(u.len());
        let joints = before.y.first()?.len();
        let shape = Shape { robots: 1, samples: u.len() / joints, joints };
        let is_finite = u.iter().chain(&y).all(|value| value.is_finite());
        Series::new(shape, rate_hz, u, y).ok().filter(|_| is_finite)
    }

    /// Positions minus the path, rad.
    fn errors(&self) -> impl Iterator<Item = Joints<f64>> {
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

/// For each joint, the 99th percentile of an excitation's absolute torques, N·m.
fn excited_nm(simulation: &SimulateSpec) -> Joints<f64> {
    /// Number of simulated trajectories. One joint then has 25 600 torques, of which 1 % are above
    /// the percentile.
    const TRAJECTORIES: u64 = 256;
    const TIMES: u32 = 100;
    let scenarios = Scenarios::new(simulation);
    let duration_s = f64::from(simulation.samples) / simulation.rate_hz;
    let mut torques: Vec<Joints<f64>> = Vec::new();
    for index in 0..TRAJECTORIES {
        let excitation = scenarios.draw(index, 1).excitation;
        let Some(law) = excitation.torques() else { continue };
        torques.extend((0..TIMES).map(|k| law.at(duration_s * f64::from(k) / f64::from(TIMES))));
    }
    Joints::from_fn(simulation.joints(), |joint| {
        let mut sizes: Vec<f64> = torques.iter().map(|torques| torques[joint].abs()).collect();
        let position = sizes.len() * 99 / 100;
        *sizes.select_nth_unstable_by(position, f64::total_cmp).1
    })
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

fn describe(error: &EvaluationError, step: usize) -> String {
    let source = std::error::Error::source(error).map(|source| format!(": {source}"));
    format!("at sample {step}: {error}{}", source.unwrap_or_default())
}
