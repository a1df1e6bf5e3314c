//! The planner of a closed loop.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::{RobotDescription, RobotModel};

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
pub(super) fn usual_noise_nm(robot: &RobotDescription) -> Vec<f64> {
    robot.per_joint(|joint| f64::min(2.0, joint.torque_nm / 6.0))
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
