//! Closed loop: model predictive control moves robots along a path.

use std::f64::consts::TAU;
use std::iter;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::kind::KindSpec;
use crate::{
    Bootstrap, CheckpointRef, DataSource, DataSpec, Doubt, Execution, Given, Gravity,
    JointDescription, MAX_JOINTS, Normalization, Range, Reference, RobotDescription, RobotModel,
    SpecError, Training,
};

/// Moves robots along a path by model predictive control, once with every predictor.
///
/// Each robot is excited for `context` samples as in `data`, and then controlled. All controllers
/// have the same planner, random numbers and cost. They differ only in their predictions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ControlSpec {
    /// A simulation. Its first `robots` trajectories give the robots, their initial states and
    /// their excitation before control.
    pub data: DataSource,
    /// Models that plan, each as a controller.
    #[serde(default)]
    pub checkpoints: Vec<CheckpointRef>,
    /// Controllers without a checkpoint. Default: all.
    #[serde(default = "ControlBaseline::all")]
    pub baselines: Vec<ControlBaseline>,
    /// Number of robots.
    #[serde(default = "defaults::robots")]
    pub robots: u32,
    /// Number of excitation samples before control begins. A checkpoint always sees this many of
    /// the latest samples.
    #[serde(default = "defaults::context")]
    pub context: u32,
    /// Duration of control, s.
    #[serde(default = "defaults::duration_s")]
    pub duration_s: f64,
    /// The path that every robot should follow.
    #[serde(default)]
    pub path: ControlPath,
    /// How all controllers plan their torques.
    #[serde(default)]
    pub planner: Planner,
    /// Seed of the planner's random numbers, 0 to 2^53 - 1.
    #[serde(default)]
    pub seed: u64,
    /// How the report's intervals over robots are resampled.
    #[serde(default)]
    pub bootstrap: Bootstrap,
    /// How the job is executed. It is not part of the digest.
    #[serde(default, skip_serializing_if = "Execution::is_default")]
    pub execution: Execution,
}

/// A controller without a checkpoint.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum ControlBaseline {
    /// Applies no torque. It shows how far the path leads away.
    ZeroTorque,
    /// Plans with q̇ = u / D and the nominal damping D.
    DampedIntegrator,
    /// Plans with a simulator of the nominal arm, from the robot's true state.
    NominalSimulator,
    /// Plans with a simulator of the robot itself, from its true state. It shows the best result of
    /// this planner.
    Oracle,
}

impl ControlBaseline {
    /// All baselines, from the one that knows least to the one that knows most.
    pub fn all() -> Vec<Self> {
        vec![Self::ZeroTorque, Self::DampedIntegrator, Self::NominalSimulator, Self::Oracle]
    }

    /// Its name in specs and tables.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::ZeroTorque => "zero-torque",
            Self::DampedIntegrator => "damped-integrator",
            Self::NominalSimulator => "nominal-simulator",
            Self::Oracle => "oracle",
        }
    }
}

/// Desired joint positions over time. The path begins at rest, at the robot's position when control
/// begins. Each joint moves towards the limit that is farther away.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ControlPath {
    /// Goes there and back, again and again.
    Swing(Swing),
    /// Goes to another place and rests there.
    PointToPoint(PointToPoint),
}

/// q(t) = q(0) ± a (1 − cos 2πft) / 2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Swing {
    /// a of each joint, rad. Default: as far as the joint's free range allows, at most 0.4 rad.
    pub amplitude_rad: Vec<f64>,
    /// f of each joint, Hz. Default: 0.15 to 0.3.
    pub frequency_hz: Vec<f64>,
}

/// q(t) = q(0) ± d (10 s³ − 15 s⁴ + 6 s⁵) with s = t / T up to T. It has minimum jerk (Flash and
/// Hogan 1985, "The coordination of arm movements").
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PointToPoint {
    /// d of each joint, rad.
    pub displacement_rad: Vec<f64>,
    /// T, s.
    pub duration_s: f64,
}

impl Default for ControlPath {
    fn default() -> Self {
        Self::Swing(Swing::default())
    }
}

impl Default for Swing {
    fn default() -> Self {
        Self::of(RobotModel::panda().description())
    }
}

impl Swing {
    /// The default path for `robot`. For a Panda, the torques that q̇ = u / D needs for it lie
    /// within those of the training set D1.
    fn of(robot: &RobotDescription) -> Self {
        const AMPLITUDE_RAD: f64 = 0.4;
        const FREQUENCY_HZ: [f64; MAX_JOINTS] = [0.15, 0.2, 0.25, 0.15, 0.2, 0.25, 0.3, 0.15];
        let frequency_hz = FREQUENCY_HZ.into_iter().take(robot.joints.len()).collect();
        Self {
            amplitude_rad: robot.per_joint(|joint| AMPLITUDE_RAD.min(free(joint))),
            frequency_hz,
        }
    }
}

/// How far a joint can move from any position within its limits, rad. Half its range is free on one
/// side.
fn free(joint: &JointDescription) -> f64 {
    let Range { min, max } = joint.position_rad;
    0.5 * (max - min) - CLEARANCE_RAD
}

impl ControlPath {
    /// Distance of each joint from its initial position after `t` seconds, rad; not negative.
    pub fn displacement(&self, t: f64) -> Vec<f64> {
        match self {
            Self::Swing(Swing { amplitude_rad, frequency_hz }) => {
                let joints = amplitude_rad.iter().zip(frequency_hz);
                let swung = |(amplitude, frequency): (&f64, &f64)| {
                    0.5 * amplitude * (1.0 - (TAU * frequency * t).cos())
                };
                joints.map(swung).collect()
            }
            Self::PointToPoint(PointToPoint { displacement_rad, duration_s }) => {
                let s = (t / duration_s).clamp(0.0, 1.0);
                let share = s * s * s * (10.0 + s * (6.0 * s - 15.0));
                displacement_rad.iter().map(|displacement| displacement * share).collect()
            }
        }
    }
}

/// Model predictive path integral control (Williams et al. 2017, "Information theoretic MPC for
/// model-based reinforcement learning", algorithm 2). It predicts the results of torque sequences
/// around the last plan. The new plan is their mean, weighted by e to the power of minus their
/// cost.
///
/// There are three differences to the paper. The temperature is relative. Noise is linear between
/// knots, so torques stay as smooth as in the models' training data. The cost of effort is
/// explicit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Planner {
    /// Number of torque sequences per iteration. The first is the plan itself.
    pub samples: u32,
    /// Number of iterations per plan.
    pub iterations: u32,
    /// Length of a plan in samples. A checkpoint with a longer horizon gets the plan's last torques
    /// held, and its prediction beyond the plan does not count.
    pub horizon: u32,
    /// Number of samples of a plan that are executed before the next plan is made.
    pub replan_every: u32,
    /// Standard deviation of each joint's noise at the knots, N·m. Default: 2, or a sixth of the
    /// rated torque if that is less.
    pub noise_nm: Vec<f64>,
    /// Number of samples between two knots of the noise.
    pub knot_every: u32,
    /// Factor of the noise from one iteration to the next.
    pub noise_decay: f64,
    /// λ of the weights exp(−(S − min S) / (λ (mean S − min S))).
    pub temperature: f64,
    /// Whether the torques of a joint are weighted by its own cost or by that of all joints.
    pub weights: PlanWeights,
    /// Weight of the effort, rad²/(N·m)². The cost S is the mean of (q − path)² over the plan, plus
    /// this weight times the mean of u².
    pub effort_rad2_nm2: f64,
}

/// The cost that weights a torque sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PlanWeights {
    /// Each joint's torques are weighted by that joint's own cost. The effects of other joints
    /// count as noise. On an arm with dominant damping this needs far fewer samples.
    Joint,
    /// The torques of all joints are weighted by their common cost, as published.
    Sequence,
}

impl Default for Planner {
    fn default() -> Self {
        Self {
            samples: 64,
            iterations: 2,
            horizon: 30,
            replan_every: 4,
            noise_nm: usual_noise_nm(RobotModel::panda().description()),
            knot_every: 15,
            noise_decay: 0.5,
            temperature: 0.1,
            weights: PlanWeights::Joint,
            effort_rad2_nm2: 1e-7,
        }
    }
}

/// 2 N·m at every joint of a Panda. It is less for a joint with a lower rated torque than any of
/// the Panda's, 12 N·m.
fn usual_noise_nm(robot: &RobotDescription) -> Vec<f64> {
    robot.per_joint(|joint| f64::min(2.0, joint.torque_nm / 6.0))
}

mod defaults {
    pub const fn robots() -> u32 {
        8
    }
    pub const fn context() -> u32 {
        320
    }
    pub const fn duration_s() -> f64 {
        4.0
    }
}

/// Smallest distance of a path to a joint's limit from any start, rad.
const CLEARANCE_RAD: f64 = 0.1;

/// The largest number of control steps of one robot.
const MAX_STEPS: f64 = 100_000.0;

impl ControlSpec {
    /// Number of control samples at `rate_hz`.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "checked to be 1 to 100 000"
    )]
    pub fn steps(&self, rate_hz: f64) -> u32 {
        (self.duration_s * rate_hz).round() as u32
    }
}

impl ControlSpec {
    /// Compares the spec with the data and the trainings that its references were resolved to.
    ///
    /// # Errors
    /// Names each field that does not fit `data` or a training, with both numbers.
    pub fn check_inputs(
        &self,
        data: &DataSpec,
        trainings: &[Training<'_>],
    ) -> Result<(), SpecError> {
        let mut violations = Violations::default();
        let Some(simulation) = data.simulation() else {
            return Err(SpecError::one(
                "data",
                "recordings",
                "a simulation, whose robots can move",
            ));
        };
        let robot = simulation.robot.description();
        self.path.check_robot(robot, &mut violations);
        violations.one_per_joint("planner.noise_nm", &self.planner.noise_nm, robot.joints.len());
        let strongest = robot.joints.iter().map(|joint| joint.torque_nm).fold(0.0, f64::max);
        for (i, noise) in self.planner.noise_nm.iter().enumerate() {
            if *noise > strongest {
                let allowed = format!("at most {strongest}, the largest torque of any joint");
                violations.add(&format!("planner.noise_nm[{i}]"), noise, allowed);
            }
        }
        if u64::from(self.robots) > simulation.trajectories {
            let allowed = format!("at most the data's trajectories, {}", simulation.trajectories);
            violations.add("robots", self.robots, allowed);
        }
        if self.context > simulation.samples {
            let allowed = format!("at most the data's samples, which are {}", simulation.samples);
            violations.add("context", self.context, allowed);
        }
        if simulation.robot.gravity == Gravity::Compensated {
            let allowed = "off or on: a plan holds all torques that act";
            violations.add("data.robot.gravity", "compensated", allowed);
        }
        if simulation.controller.is_some() {
            let allowed = "left out: this job moves the robots itself, after torques of chirp, multisine or steps";
            violations.add("data.controller", "given", allowed);
        }
        let steps = self.duration_s * simulation.rate_hz;
        if !(0.5..=MAX_STEPS).contains(&steps) {
            let allowed = format!("1 to {MAX_STEPS} samples at {} Hz", simulation.rate_hz);
            violations.add("duration_s", self.duration_s, allowed);
        }
        for (i, training) in trainings.iter().enumerate() {
            let field = format!("checkpoints[{i}]");
            let context = training.spec.context;
            if context != self.context {
                let asked = format!("context {}, as this job asks", self.context);
                violations.add(&field, format!("trained with context {context}"), asked);
            }
            let rate_hz = training.data.rate_hz();
            if (rate_hz - simulation.rate_hz).abs() > f64::EPSILON {
                let asked = format!("rate_hz {}, as the data has", simulation.rate_hz);
                violations.add(&field, format!("trained with rate_hz {rate_hz}"), asked);
            }
            let joints = training.data.joints();
            if joints != robot.joints.len() {
                let asked = format!("{} joints, as the data's robots have", robot.joints.len());
                violations.add(&field, format!("trained with {joints} joints"), asked);
            }
            let foreseen = training.data.samples().saturating_sub(context);
            if self.planner.horizon > foreseen {
                let allowed = format!("at most {foreseen}, the horizon of {field}");
                violations.add("planner.horizon", self.planner.horizon, allowed);
            }
            if training.spec.given != Given::Torques {
                let allowed = "one that is given torques, which the planner chooses";
                violations.add(&field, "trained with given references", allowed);
            }
            if training.spec.normalization == Normalization::PaperLeaky {
                let allowed = "one that does not need the future that it predicts";
                violations.add(&field, "trained with normalization paper-leaky", allowed);
            }
        }
        violations.finish()
    }
}

impl KindSpec for ControlSpec {
    /// Replaces default lists, which are for the Panda, if the data's robot has another number of
    /// joints.
    fn fit_to_data(&mut self, data: &DataSpec) {
        let Some(simulation) = data.simulation() else { return };
        let robot = simulation.robot.description();
        if robot.joints.len() == RobotModel::panda().description().joints.len() {
            return;
        }
        let fitting = Swing::of(robot);
        if let ControlPath::Swing(swing) = &mut self.path {
            let usual = Swing::default();
            replace_usual(&mut swing.amplitude_rad, &usual.amplitude_rad, fitting.amplitude_rad);
            replace_usual(&mut swing.frequency_hz, &usual.frequency_hz, fitting.frequency_hz);
        }
        let usual = Planner::default().noise_nm;
        replace_usual(&mut self.planner.noise_nm, &usual, usual_noise_nm(robot));
    }

    fn execution(&self) -> Execution {
        self.execution.clone()
    }

    fn references(&mut self) -> Vec<Reference<'_>> {
        let checkpoints = Reference::checkpoints(&mut self.checkpoints);
        iter::once(Reference::data(&mut self.data)).chain(checkpoints).collect()
    }

    fn doubts(&self) -> Vec<Doubt> {
        self.data.doubts("data")
    }
}

fn replace_usual(list: &mut Vec<f64>, usual: &[f64], fitting: Vec<f64>) {
    if list == usual {
        *list = fitting;
    }
}

impl Check for ControlSpec {
    fn check(&self, violations: &mut Violations) {
        violations.part("data", &self.data);
        if self.checkpoints.is_empty() && self.baselines.is_empty() {
            violations.add("checkpoints", "[]", "at least one checkpoint or baseline");
        }
        violations.length("checkpoints", self.checkpoints.len(), 0..=20);
        violations.no_duplicates("checkpoints", &self.checkpoints);
        violations.no_duplicates("baselines", &self.baselines);
        violations.within("robots", self.robots, 1..=100);
        violations.within("context", self.context, 2..=9_999);
        violations.within("duration_s", self.duration_s, 0.01..=600.0);
        violations.part("path", &self.path);
        violations.part("planner", &self.planner);
        violations.seed("seed", self.seed);
        violations.within("bootstrap.resamples", self.bootstrap.resamples, 100..=100_000);
        violations.seed("bootstrap.seed", self.bootstrap.seed);
        violations.part("execution", &self.execution);
    }
}

impl ControlPath {
    /// Checks that an arm can follow the path from any start.
    fn check_robot(&self, robot: &RobotDescription, violations: &mut Violations) {
        let joints = robot.joints.len();
        let (field, displacement) = match self {
            Self::Swing(Swing { amplitude_rad, frequency_hz }) => {
                violations.one_per_joint("path.swing.frequency_hz", frequency_hz, joints);
                ("path.swing.amplitude_rad", amplitude_rad)
            }
            Self::PointToPoint(PointToPoint { displacement_rad, .. }) => {
                ("path.point-to-point.displacement_rad", displacement_rad)
            }
        };
        violations.one_per_joint(field, displacement, joints);
        for (i, (value, joint)) in displacement.iter().zip(&robot.joints).enumerate() {
            let free = free(joint);
            if *value > free {
                let allowed = format!(
                    "0 to {free:.4}, which keeps the joint within its limits from any start"
                );
                violations.add(&format!("{field}[{i}]"), value, allowed);
            }
        }
    }
}

impl Check for ControlPath {
    fn check(&self, violations: &mut Violations) {
        match self {
            Self::Swing(Swing { amplitude_rad, frequency_hz }) => {
                violations.all_within("swing.amplitude_rad", amplitude_rad, &(0.0..=100.0));
                violations.all_within("swing.frequency_hz", frequency_hz, &(0.001..=100.0));
            }
            Self::PointToPoint(PointToPoint { displacement_rad, duration_s }) => {
                let field = "point-to-point.displacement_rad";
                violations.all_within(field, displacement_rad, &(0.0..=100.0));
                violations.within("point-to-point.duration_s", *duration_s, 0.01..=600.0);
            }
        }
    }
}

impl Check for Planner {
    fn check(&self, violations: &mut Violations) {
        violations.within("samples", self.samples, 2..=1024);
        violations.within("iterations", self.iterations, 1..=20);
        violations.within("horizon", self.horizon, 1..=1000);
        let horizon = self.horizon.clamp(1, 1000);
        violations.within("replan_every", self.replan_every, 1..=horizon);
        violations.within("knot_every", self.knot_every, 1..=horizon);
        violations.all_within("noise_nm", &self.noise_nm, &(0.001..=1e5));
        violations.within("noise_decay", self.noise_decay, 0.01..=1.0);
        violations.within("temperature", self.temperature, 1e-4..=1e4);
        violations.within("effort_rad2_nm2", self.effort_rad2_nm2, 0.0..=1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_begins_at_rest_and_goes_as_far_as_it_says() {
        let point = PointToPoint { displacement_rad: vec![0.7; 7], duration_s: 2.0 };
        for path in [ControlPath::default(), ControlPath::PointToPoint(point.clone())] {
            assert_eq!(path.displacement(0.0), [0.0; 7]);
            assert!(path.displacement(1e-3).iter().all(|value| (0.0..1e-5).contains(value)));
        }
        let there = ControlPath::PointToPoint(point);
        assert!((there.displacement(1.0)[3] - 0.35).abs() < 1e-12);
        assert!((there.displacement(9.0)[3] - 0.7).abs() < 1e-12);
        // Joint 5 moves at 0.2 Hz.
        assert!((ControlPath::default().displacement(2.5)[4] - 0.4).abs() < 1e-12);
    }
}
