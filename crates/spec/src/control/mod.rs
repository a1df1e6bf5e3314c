//! Closed loop: predictors plan the torques of robots, or add torques to those of their controllers.

mod inputs;
mod path;
mod planner;

use std::iter;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::kind::KindSpec;
use crate::{Bootstrap, CheckpointRef, DataSource, DataSpec, Doubt, Execution, Reference};

use self::inputs::fit_to_robot;
pub use self::path::{ControlPath, PointToPoint, Swing};
pub use self::planner::{PlanWeights, Planner};

/// Controls robots, once with every predictor.
///
/// Each robot moves for `context` samples as in `data`, and then for `duration_s` under control.
/// Where torques move the robots of `data`, a planner moves them along `path` by model predictive
/// control. All controllers have the same planner, random numbers and cost, and differ only in their
/// predictions. Where the robots of `data` have a controller, they go on along their references, and
/// each predictor adds the torques that it expects the motion to take.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ControlSpec {
    /// A simulation. Its first `robots` trajectories give the robots, their initial states and
    /// their excitation before control.
    pub data: DataSource,
    /// Models that plan, each as a controller.
    #[serde(default)]
    pub checkpoints: Vec<CheckpointRef>,
    /// Controllers without a checkpoint. Default: all, but `identification` only where the robots of
    /// `data` have a controller.
    #[serde(default = "ControlBaseline::usual")]
    pub baselines: Vec<ControlBaseline>,
    /// Number of robots.
    #[serde(default = "defaults::robots")]
    pub robots: u32,
    /// Number of samples before control begins. A checkpoint that plans always sees this many of the
    /// latest samples. One that adds torques sees the samples before control begins.
    #[serde(default = "defaults::context")]
    pub context: u32,
    /// Duration of control, s.
    #[serde(default = "defaults::duration_s")]
    pub duration_s: f64,
    /// The path that every robot should follow. Left out where the robots of `data` have a
    /// controller, which follow their references.
    #[serde(default)]
    pub path: ControlPath,
    /// How all controllers plan their torques. Left out where the robots of `data` have a controller.
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
    /// Applies no torque, or none beside the robot's own controller. It shows how far the path leads
    /// away.
    ZeroTorque,
    /// Plans with q̇ = u / D and the nominal damping D, or adds u = D q̇.
    DampedIntegrator,
    /// Plans with a simulator of the nominal arm, from the robot's true state, or adds the torques
    /// of the nominal arm.
    NominalSimulator,
    /// Adds the torques of the arm whose parameters fit the samples before control best. It does not
    /// plan.
    Identification,
    /// Plans with a simulator of the robot itself, from its true state, or adds the robot's own
    /// torques. It shows the best result.
    Oracle,
}

impl ControlBaseline {
    /// All baselines, from the one that knows least to the one that knows most.
    pub fn all() -> Vec<Self> {
        vec![
            Self::ZeroTorque,
            Self::DampedIntegrator,
            Self::NominalSimulator,
            Self::Identification,
            Self::Oracle,
        ]
    }

    /// Those that plan.
    pub fn usual() -> Vec<Self> {
        Self::all().into_iter().filter(|baseline| *baseline != Self::Identification).collect()
    }

    /// Its name in specs and tables.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::ZeroTorque => "zero-torque",
            Self::DampedIntegrator => "damped-integrator",
            Self::NominalSimulator => "nominal-simulator",
            Self::Identification => "identification",
            Self::Oracle => "oracle",
        }
    }
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

impl KindSpec for ControlSpec {
    /// Replaces default lists: those for the Panda, if the data's robot has another number of joints,
    /// and that of the baselines, if it has a controller.
    fn fit_to_data(&mut self, data: &DataSpec) {
        let Some(simulation) = data.simulation() else { return };
        let robot = simulation.robot.description();
        fit_to_robot(&mut self.path, &mut self.planner, robot);
        if simulation.controller.is_some() && self.baselines == ControlBaseline::usual() {
            self.baselines = ControlBaseline::all();
        }
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
