//! Controllers that make robots follow references: drawn per trajectory, one robot per lane.

use std::f64::consts::TAU;

use simd::{Lanes, MAX_LANES};
use spec::{ControlLaw, Controller, MAX_DELAY_PERIODS, SimulateSpec};

use crate::forward_dynamics::Dynamics;
use crate::gains::{Gains, Known, dims};
use crate::hand_task::{HandTask, Moment, MoveHand, PushHand};
use crate::kernels::{Gravity, MassMatrixAndBias};
use crate::model::Model;
use crate::planner::Interpolate;
use crate::reference::{Reference, ReferenceState};
use crate::spatial::Turn;
use crate::structure::Structure;
use crate::{Robot, gravity};

/// A reference, and the controller that follows it.
#[derive(Clone, Debug, PartialEq)]
pub struct Tracking {
    /// The motion that is followed.
    pub reference: Reference,
    /// The drawn gains.
    pub gains: Gains,
    /// Torques that are added to the controller's commands from the first recorded sample on,
    /// `[control period, joint]`, N·m. Beyond their end nothing is added. Drawn scenarios have none.
    pub added_nm: Vec<f32>,
}

/// The errors of the positions that a controller measures.
#[derive(Clone, Copy)]
pub(crate) struct Encoder {
    /// Standard deviation, rad.
    noise_rad: f64,
    resolution_rad: f64,
}

impl Encoder {
    pub(crate) fn new(spec: &SimulateSpec) -> Self {
        let observations = &spec.observations;
        Self {
            noise_rad: observations.position_noise_rad,
            resolution_rad: observations.position_resolution_rad,
        }
    }

    pub(crate) fn is_noisy(&self) -> bool {
        self.noise_rad > 0.0
    }
}

/// Controllers of robots in lanes. They share their law and differ in their gains.
pub(crate) struct Controllers<'a, L, const N: usize> {
    law: &'a ControlLaw,
    encoder: Encoder,
    known: Model<L, N>,
    known_arm: &'a Robot,
    dynamics: Dynamics<L, N>,
    /// Whether the law of single joints needs the nominal arm.
    has_gravity: bool,
    /// Duration of a control period, s.
    period_s: f64,
    /// Duration of a sampling period, s.
    sample_s: f64,
    smoothing: L,
    largest_torque: [L; N],
    /// The largest change within a control period, N·m.
    largest_change: Option<L>,
    kp: [L; N],
    kd: [L; N],
    ki: [L; N],
    /// 1 in the lanes with this delay, and 0 in the others.
    has_delay: [L; DELAYS],
    /// Coefficients of the reference in the present sampling period.
    reference: [[L; 6]; N],
    measured: [L; N],
    velocity: [L; N],
    /// ∫(r − q) dt.
    sum: [L; N],
    /// The latest commands, the last one first.
    commands: [[L; N]; DELAYS],
    /// The largest commands since they were taken, and the largest of their negatives; 0 at least.
    peaks: [[L; N]; 2],
    task: HandTask<L, N>,
}

const DELAYS: usize = MAX_DELAY_PERIODS as usize + 1;

impl<'a, L: Lanes, const N: usize> Controllers<'a, L, N> {
    #[inline(always)]
    pub(crate) fn new(
        structure: impl Structure<N>,
        spec: &'a SimulateSpec,
        controller: &'a Controller,
        known: &'a Known,
    ) -> Self {
        let zero = [L::splat(0.0); N];
        let period_s = 1.0 / controller.rate_hz;
        // A backward Euler step of the low-pass.
        let ratio = TAU * controller.velocity_cutoff_hz * period_s;
        let mut largest_torque = zero;
        for (joint, described) in spec.robot.description().joints.iter().enumerate() {
            largest_torque[joint] = L::splat(described.torque_nm * controller.torque_share);
        }
        Self {
            law: &controller.law,
            encoder: Encoder::new(spec),
            known: Model::splat(structure, &known.arm),
            known_arm: &known.arm,
            dynamics: Dynamics::zero(),
            has_gravity: known.arm.gravity != 0.0,
            period_s,
            sample_s: 1.0 / spec.rate_hz,
            smoothing: L::splat(ratio / (1.0 + ratio)),
            largest_torque,
            largest_change: controller.torque_rate_nm_s.map(|rate| L::splat(rate * period_s)),
            kp: zero,
            kd: zero,
            ki: zero,
            has_delay: [L::splat(0.0); DELAYS],
            reference: [[L::splat(0.0); 6]; N],
            measured: zero,
            velocity: zero,
            sum: zero,
            commands: [zero; DELAYS],
            peaks: [zero; 2],
            task: HandTask::new(dims(controller, known.arm.joints()), &known.arm, period_s),
        }
    }

    /// Puts the controller of a trajectory that starts at `start` into a lane. Until its first
    /// torque acts, the arm's weight is held.
    #[inline(never)]
    pub(crate) fn set_lane(&mut self, lane: usize, gains: &Gains, start: &ReferenceState) {
        let weight = gravity(self.known_arm, start.r);
        self.task.set_lane(lane, gains);
        for joint in 0..start.r.len() {
            if !self.task.is_of_hand() {
                self.kp[joint].set_lane(lane, gains.kp[joint]);
                self.kd[joint].set_lane(lane, gains.kd[joint]);
                self.ki[joint].set_lane(lane, gains.ki[joint]);
            }
            self.measured[joint].set_lane(lane, start.r[joint]);
            self.velocity[joint].set_lane(lane, start.rd[joint]);
            self.sum[joint].set_lane(lane, 0.0);
            for command in &mut self.commands {
                command[joint].set_lane(lane, weight[joint]);
            }
        }
        for (delay, has_delay) in (0..).zip(&mut self.has_delay) {
            has_delay.set_lane(lane, if delay == gains.delay_periods { 1.0 } else { 0.0 });
        }
    }

    /// Gives a lane its reference from one sample to the next.
    pub(crate) fn set_reference(
        &mut self,
        lane: usize,
        from: &ReferenceState,
        to: &ReferenceState,
    ) {
        let (period_s, coefficients) = (self.sample_s, &mut self.reference);
        L::run(Interpolate { lane, period_s, from, to, coefficients });
    }

    /// The positions that the controllers measured last, rad.
    pub(crate) fn measured(&self) -> &[L; N] {
        &self.measured
    }

    /// The largest distance of a joint from its reference at the beginning of the present sampling
    /// period, rad.
    #[inline(always)]
    pub(crate) fn largest_error(&self, joints: usize, q: &[L; N]) -> L {
        let mut largest = L::splat(0.0);
        for joint in 0..joints {
            let error = self.reference[joint][0] - q[joint];
            largest = largest.max(error).max(-error);
        }
        largest
    }

    /// The largest commands of each joint since the last call, and the largest of their negatives; 0
    /// at least.
    #[inline(always)]
    pub(crate) fn take_peaks(&mut self) -> [[L; N]; 2] {
        std::mem::replace(&mut self.peaks, [[L::splat(0.0); N]; 2])
    }

    /// Above 0 where the posture of a controller of the hand was singular since the last call.
    #[inline(always)]
    pub(crate) fn take_singular(&mut self) -> L {
        self.task.take_singular()
    }

    /// The torques of the control period that begins at `period` of the sampling period's periods.
    /// `noise` is of variance 1. `added` is added to the commands, N·m.
    #[inline(always)]
    pub(crate) fn torques<S: Structure<N>>(
        &mut self,
        structure: S,
        period: usize,
        q: &[L; N],
        noise: Option<&[[f32; MAX_LANES]; N]>,
        added: Option<&[[f32; MAX_LANES]; N]>,
        torques: &mut [L; N],
    ) {
        let joints = structure.joints();
        self.measure(joints, q, noise);

        let zero = L::splat(0.0);
        let share = L::splat(period as f64 * self.period_s / self.sample_s);
        let [per_s, per_s2] =
            [L::splat(1.0 / self.sample_s), L::splat(1.0 / (self.sample_s * self.sample_s))];
        let period_s = L::splat(self.period_s);
        let mut command = [zero; N];
        let mut position = [zero; N];
        let mut speed = [zero; N];
        let mut acceleration = [zero; N];
        for joint in 0..joints {
            let [c0, c1, c2, c3, c4, c5] = self.reference[joint];
            let r = c5
                .mul_add(share, c4)
                .mul_add(share, c3)
                .mul_add(share, c2)
                .mul_add(share, c1)
                .mul_add(share, c0);
            let times = |coefficient: L, factor: f64| coefficient * L::splat(factor);
            let rd = times(c5, 5.0)
                .mul_add(share, times(c4, 4.0))
                .mul_add(share, times(c3, 3.0))
                .mul_add(share, times(c2, 2.0))
                .mul_add(share, c1)
                * per_s;
            acceleration[joint] = times(c5, 20.0)
                .mul_add(share, times(c4, 12.0))
                .mul_add(share, times(c3, 6.0))
                .mul_add(share, times(c2, 2.0))
                * per_s2;
            (position[joint], speed[joint]) = (r, rd);
            let error = r - self.measured[joint];
            self.sum[joint] = error.mul_add(period_s, self.sum[joint]);
            let slower = rd - self.velocity[joint];
            command[joint] = self.kp[joint]
                .mul_add(error, self.kd[joint].mul_add(slower, self.ki[joint] * self.sum[joint]));
        }
        match self.law {
            ControlLaw::JointPd(_) => {
                if self.has_gravity {
                    let mut gravity = [zero; N];
                    let (model, q) = (&self.known, &self.measured);
                    L::run(Gravity { structure, model, q, gravity: &mut gravity });
                    for joint in 0..joints {
                        command[joint] = command[joint] + gravity[joint];
                    }
                }
            }
            ControlLaw::ComputedTorque(_) => {
                let velocity = self.velocity;
                self.evaluate(structure, &velocity);
                for joint in 0..joints {
                    acceleration[joint] = acceleration[joint] + command[joint];
                }
                let matrix = &self.dynamics.mass_matrix;
                for row in 0..joints {
                    let mut torque = self.dynamics.bias[row];
                    for column in 0..joints {
                        // Only entries on and below the diagonal are set.
                        let entry = matrix[row.max(column)][row.min(column)];
                        torque = entry.mul_add(acceleration[column], torque);
                    }
                    command[row] = torque;
                }
            }
            ControlLaw::OperationalSpace(_) | ControlLaw::CartesianImpedance(_) => {
                let Self { measured: q, velocity: v, known, task, .. } = self;
                let moment = Moment { r: &position, rd: &speed, rdd: &acceleration, q, v };
                task.look(structure, known, period, &moment);
                let command = &mut command;
                if matches!(self.law, ControlLaw::OperationalSpace(_)) {
                    L::run(MoveHand { structure, task, known, moment, command });
                } else {
                    L::run(PushHand { structure, task, known, moment, command });
                }
            }
        }
        if let Some(added) = added {
            for joint in 0..joints {
                command[joint] = command[joint] + L::load(&added[joint]);
            }
        }
        self.limit(joints, &mut command);
        self.delay(joints, command, torques);
    }

    /// Measures positions, and smooths their differences to velocities.
    #[inline(always)]
    fn measure(&mut self, joints: usize, q: &[L; N], noise: Option<&[[f32; MAX_LANES]; N]>) {
        let Encoder { noise_rad, resolution_rad } = self.encoder;
        let deviation = L::splat(noise_rad);
        let (step, steps) = (L::splat(resolution_rad), L::splat(1.0 / resolution_rad));
        let rate = L::splat(1.0 / self.period_s);
        let rounds = resolution_rad > 0.0;
        for joint in 0..joints {
            let mut measured = q[joint];
            if let Some(noise) = noise {
                measured = deviation.mul_add(L::load(&noise[joint]), measured);
            }
            if rounds {
                measured = (measured * steps).round() * step;
            }
            let difference = (measured - self.measured[joint]) * rate;
            self.velocity[joint] =
                self.smoothing.mul_add(difference - self.velocity[joint], self.velocity[joint]);
            self.measured[joint] = measured;
        }
    }

    /// The nominal arm's equation of motion at the measured positions.
    #[inline(always)]
    fn evaluate<S: Structure<N>>(&mut self, structure: S, qd: &[L; N]) {
        let mut turns = [Turn::none(); N];
        structure.turns(&self.known, &self.measured, &mut turns);
        let (model, dynamics) = (&self.known, &mut self.dynamics);
        L::run(MassMatrixAndBias { structure, model, turns: &turns, qd, dynamics });
    }

    #[inline(always)]
    fn limit(&mut self, joints: usize, command: &mut [L; N]) {
        for joint in 0..joints {
            let most = self.largest_torque[joint];
            command[joint] = clamped(command[joint], most);
            if let Some(most) = self.largest_change {
                let before = self.commands[0][joint];
                command[joint] = before + clamped(command[joint] - before, most);
            }
            let [highest, lowest] = &mut self.peaks;
            highest[joint] = highest[joint].max(command[joint]);
            lowest[joint] = lowest[joint].max(-command[joint]);
        }
    }

    /// Remembers the command, and gives each lane the one that acts after its delay.
    #[inline(always)]
    fn delay(&mut self, joints: usize, command: [L; N], torques: &mut [L; N]) {
        for age in (1..DELAYS).rev() {
            self.commands[age] = self.commands[age - 1];
        }
        self.commands[0] = command;
        for joint in 0..joints {
            let mut torque = self.has_delay[0] * command[joint];
            for age in 1..DELAYS {
                torque = self.has_delay[age].mul_add(self.commands[age][joint], torque);
            }
            torques[joint] = torque;
        }
    }
}

/// `value` within ±`most`.
#[inline(always)]
fn clamped<L: Lanes>(value: L, most: L) -> L {
    let raised = value.max(-most);
    -((-raised).max(-most))
}
