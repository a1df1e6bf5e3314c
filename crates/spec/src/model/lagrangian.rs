use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::architecture::ArchitectureSpec;
use super::lengths::Lengths;
use super::residual::Residual;
use crate::check::{Check, Violations};
use crate::{Gravity, RobotModel};

/// The equations of motion of an arm with joints, learned from many robots. The masses, forces,
/// damping and friction of each robot are fitted to its own context (after deep Lagrangian
/// networks, Lutter et al. 2019, and Bayesian regression on learned features, Harrison et al.
/// 2018). It computes in N·m, rad and s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LagrangianSpec {
    /// Width of every hidden layer.
    #[serde(default = "defaults::width")]
    pub width: u32,
    /// Number of hidden layers.
    #[serde(default = "defaults::layers")]
    pub layers: u32,
    /// Number of samples of each trajectory's context that a training step uses.
    #[serde(default = "defaults::points")]
    pub points: u32,
    /// Number of particles that represent the arm's inertia. Their masses are fitted to each robot.
    #[serde(default = "defaults::particles")]
    pub particles: u32,
    /// Number of torques that depend only on the pose, as gravity does. Their strengths are fitted
    /// to each robot. 0 for none.
    #[serde(default = "defaults::forces")]
    pub forces: u32,
    /// Whether to ignore the angle of the first joint. Turning it moves the whole arm and does not
    /// change the inertia.
    #[serde(default = "defaults::turns_freely")]
    pub turns_freely: bool,
    /// The arm whose lengths and axes the law is told. Its inertia is then that of particles at
    /// known places of its links, and their masses are all that is fitted of it: there is no
    /// network, and the sizes above but `points` have no effect. `null` if the law is told nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<KnownRobot>,
    /// Takes an arm that the law is not told as a chain of rotating joints, whose lengths and axes
    /// the training finds in its first batch. The rest is as if it had been told them. `null` for a
    /// network in the place of lengths and axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chain: Option<UnknownChain>,
    /// Whether the rotor inertia of each joint is fitted to each robot. Otherwise all robots have the
    /// same.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub rotor_inertia: bool,
    /// Whether a constant torque of each joint is fitted to each robot, such as the offset of a
    /// sensor.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub torque_offset: bool,
    /// Whether the slow part of the torque that the law leaves in a context goes on over the horizon,
    /// where it decays.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub disturbance: bool,
}

/// The arm that a law is told, and whether gravity acts on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct KnownRobot {
    /// The robot.
    pub model: RobotModel,
    /// Whether the torques carry the arm's weight: not with `off`.
    #[serde(default = "defaults::gravity")]
    pub gravity: Gravity,
}

/// An arm of rotating joints, one after the other, whose lengths and axes are not known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct UnknownChain {
    /// Whether the torques carry the arm's weight: not with `off`.
    #[serde(default = "defaults::gravity")]
    pub gravity: Gravity,
}

mod defaults {
    pub const fn width() -> u32 {
        96
    }
    pub const fn layers() -> u32 {
        2
    }
    pub const fn points() -> u32 {
        24
    }
    pub const fn particles() -> u32 {
        12
    }
    pub const fn forces() -> u32 {
        12
    }
    pub const fn turns_freely() -> bool {
        true
    }
    pub const fn gravity() -> super::Gravity {
        super::Gravity::On
    }
}

impl Check for LagrangianSpec {
    fn check(&self, violations: &mut Violations) {
        violations.within("width", self.width, 1..=4096);
        violations.within("layers", self.layers, 1..=16);
        violations.within("points", self.points, 1..=1000);
        violations.within("particles", self.particles, 1..=64);
        violations.within("forces", self.forces, 0..=64);
        if let Some(robot) = &self.robot {
            violations.part("robot", robot);
            if self.chain.is_some() {
                violations.add(
                    "chain",
                    "a chain to find",
                    "nothing beside robot, which tells the arm",
                );
            }
        }
    }
}

impl Check for KnownRobot {
    fn check(&self, violations: &mut Violations) {
        violations.part("model", &self.model);
    }
}

impl ArchitectureSpec for LagrangianSpec {
    fn parts(&self) -> &'static [&'static str] {
        &[
            "hidden",
            "particles",
            "forces",
            "share",
            "armature",
            "chain",
            "masses",
            "rotor",
            "damping",
            "friction",
            "friction_slope",
            "friction_shift",
            "spread",
            "noise",
            "doubt",
        ]
    }

    fn residual(&self) -> Residual {
        Residual::None
    }

    fn is_physical(&self) -> bool {
        true
    }

    fn lengths(&self) -> Lengths {
        Lengths::Any
    }

    fn robot(&self) -> Option<&KnownRobot> {
        self.robot.as_ref()
    }
}
