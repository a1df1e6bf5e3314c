//! Gains of controllers, drawn per trajectory, and the arm that controllers know.

use std::f64::consts::TAU;

use serde::Serialize;
use spec::{ControlLaw, Controller, Range, SimulateSpec};

use crate::draws::Draws;
use crate::hand::MOTION;
use crate::reference::ReferenceState;
use crate::{Joints, Robot, bias_forces, gravity, mass_matrix};

/// The gains of one robot's controller, and its delay. They are N·m/rad, N·m·s/rad and N·m/(rad·s)
/// with `joint-pd`, and 1/s², 1/s and 1/s³ with `computed-torque`. Controllers of the hand have one
/// for each direction, first along x, y and z and then about them: 1/s² and 1/s with
/// `operational-space`; N/m, N·s/m, N·m/rad and N·m·s/rad with `cartesian-impedance`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gains {
    /// kp.
    pub kp: Joints<f64>,
    /// kd.
    pub kd: Joints<f64>,
    /// ki.
    pub ki: Joints<f64>,
    /// Control periods between a measurement and its torque.
    pub delay_periods: u32,
    /// kn, the posture's gain of a controller of the hand: 1/s² or N·m/rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kn: Option<f64>,
    /// dn, the posture's damping: 1/s or N·m·s/rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dn: Option<f64>,
}

/// The nominal arm that all controllers of a simulation know.
pub(crate) struct Known {
    pub(crate) arm: Robot,
    /// Inertia of each joint at the center of references, kg·m².
    inertia: Joints<f64>,
}

impl Known {
    /// The nominal arm of `spec` without a payload. It has no gravity if the controller does not
    /// compensate it.
    pub(crate) fn new(spec: &SimulateSpec, controller: &Controller) -> Self {
        let mut arm = Robot::nominal(&spec::RobotSpec { payload: None, ..spec.robot.clone() });
        if !controller.gravity_compensation {
            arm.gravity = 0.0;
        }
        let matrix = mass_matrix(&arm, spec.initial_state.center_rad.as_slice());
        let inertia = (0..arm.joints()).map(|joint| matrix[joint][joint]).collect();
        Self { arm, inertia }
    }

    /// The torques of a controller whose arm is on its reference, without its integral.
    pub(crate) fn on_reference(&self, law: &ControlLaw, state: &ReferenceState) -> Joints<f64> {
        let ReferenceState { r, rd, rdd } = *state;
        match law {
            ControlLaw::JointPd(_) | ControlLaw::CartesianImpedance(_) => gravity(&self.arm, r),
            ControlLaw::ComputedTorque(_) | ControlLaw::OperationalSpace(_) => {
                let bias = bias_forces(&self.arm, r, rd);
                let matrix = mass_matrix(&self.arm, r);
                let inertial = |row: usize| -> f64 {
                    rdd.iter().enumerate().map(|(column, rdd)| matrix[row][column] * rdd).sum()
                };
                Joints::from_fn(r.len(), |row| bias[row] + inertial(row))
            }
        }
    }

    pub(crate) fn draw_gains(&self, controller: &Controller, draws: &mut Draws) -> Gains {
        let (frequency_hz, ratio, integral, stiffness, damping) = match &controller.law {
            ControlLaw::OperationalSpace(law) => {
                let w = TAU * draws.uniform(law.natural_frequency_hz);
                let ratio = draws.uniform(law.damping_ratio);
                let posture = TAU * draws.uniform(law.posture_frequency_hz);
                let gains = HandGains { kp: [w * w; 2], ratio, kn: posture * posture };
                return self.draw_hand_gains(&gains, controller, draws);
            }
            ControlLaw::CartesianImpedance(law) => {
                let kp =
                    [law.stiffness_n_m, law.stiffness_nm_rad].map(|range| draws.uniform(range));
                let ratio = draws.uniform(law.damping_ratio);
                let gains = HandGains { kp, ratio, kn: draws.uniform(law.posture_nm_rad) };
                return self.draw_hand_gains(&gains, controller, draws);
            }
            ControlLaw::JointPd(law) => (
                law.natural_frequency_hz,
                law.damping_ratio,
                law.integral_per_s,
                law.stiffness_nm_rad.as_deref(),
                law.damping_nm_s_rad.as_deref(),
            ),
            ControlLaw::ComputedTorque(law) => {
                (law.natural_frequency_hz, law.damping_ratio, law.integral_per_s, None, None)
            }
        };
        let w = TAU * draws.uniform(frequency_hz);
        let ratio = draws.uniform(ratio);
        let integral = draws.uniform(integral);
        let mut gains = Gains {
            kp: self.inertia,
            kd: self.inertia,
            ki: self.inertia,
            delay_periods: delay(controller.delay_periods, draws),
            kn: None,
            dn: None,
        };
        for joint in 0..self.inertia.len() {
            let inertia = match controller.law {
                ControlLaw::JointPd(_) => self.inertia[joint],
                _ => 1.0,
            };
            let kp = stiffness.map_or(inertia * w * w, |stiffness| stiffness[joint]);
            let kd = damping.map_or(2.0 * ratio * w * inertia, |damping| damping[joint]);
            gains.kp[joint] = kp * draws.factor(controller.gain_fraction);
            gains.kd[joint] = kd * draws.factor(controller.gain_fraction);
            gains.ki[joint] = gains.kp[joint] * integral;
        }
        gains
    }

    fn draw_hand_gains(
        &self,
        HandGains { kp, ratio, kn }: &HandGains,
        controller: &Controller,
        draws: &mut Draws,
    ) -> Gains {
        let dims = dims(controller, self.arm.joints());
        let delay_periods = delay(controller.delay_periods, draws);
        let kp: Joints<f64> =
            (0..dims).map(|row| kp[row / 3] * draws.factor(controller.gain_fraction)).collect();
        Gains {
            kp,
            kd: kp.map(|kp| 2.0 * ratio * kp.sqrt() * draws.factor(controller.gain_fraction)),
            ki: Joints::splat(dims, 0.0),
            delay_periods,
            kn: Some(*kn),
            dn: Some(2.0 * kn.sqrt()),
        }
    }
}

/// The drawn gains of a controller of the hand, before each direction has its own.
struct HandGains {
    /// Along the axes, and about them.
    kp: [f64; 2],
    /// ζ.
    ratio: f64,
    kn: f64,
}

/// Numbers of the task of a controller: 6 with the hand's orientation, 3 without, and 0 of a
/// controller of joints.
pub(crate) fn dims(controller: &Controller, joints: usize) -> usize {
    match controller.law.task(joints) {
        Some(true) => MOTION,
        Some(false) => MOTION / 2,
        None => 0,
    }
}

#[expect(
    clippy::cast_sign_loss,
    clippy::cast_possible_truncation,
    reason = "a draw from 0 to 3 periods"
)]
fn delay([least, most]: [u32; 2], draws: &mut Draws) -> u32 {
    let drawn = draws.uniform(Range::new(f64::from(least), f64::from(most) + 1.0));
    (drawn as u32).min(most)
}
