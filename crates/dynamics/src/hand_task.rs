//! The task of controllers of the hand: the torques that move it, or push it, along a reference.

use simd::{Kernel, Lanes, align_stack};

use crate::Robot;
use crate::gains::Gains;
use crate::hand::{HandMotion, JointMotion, MOTION, Mount, NearTurns, Posture, TurnsAt};
use crate::model::Model;
use crate::reference::whole;
use crate::structure::Structure;
use crate::task_matrix::{Factors, Scratch};

/// A task is singular where a pivot of its matrix is below this share of the entry that it comes
/// from: two directions in which the hand moves are almost one.
const LEAST_PIVOT: f64 = 1e-4;

/// The longest time for which turns follow from earlier ones, s. Joints move by far less than half
/// a radian in it.
const NEAR_S: f64 = 0.02;

/// The gains of controllers of the hand. One robot per lane.
pub(crate) struct HandTask<L, const N: usize> {
    /// Numbers of the task: 6 with the hand's orientation, 3 without, and 0 of controllers of
    /// joints.
    dims: usize,
    kp: [L; MOTION],
    kd: [L; MOTION],
    kn: L,
    dn: L,
    /// Above 0 where the posture was singular since the last sample.
    singular: L,
    mount: Mount<L>,
    /// 1 if the task has the hand's orientation, and 0 otherwise.
    turning: L,
    /// Turns of measured joints and of those on the reference.
    measured: NearTurns<L, N>,
    wanted: NearTurns<L, N>,
    /// Control periods between two evaluations of these turns.
    stride: usize,
    scratch: Scratch<L, N>,
}

/// The measurements and references that a controller knows in a control period.
pub(crate) struct Moment<'a, L, const N: usize> {
    /// The reference and its derivatives.
    pub(crate) r: &'a [L; N],
    pub(crate) rd: &'a [L; N],
    pub(crate) rdd: &'a [L; N],
    /// Measured positions and velocities.
    pub(crate) q: &'a [L; N],
    pub(crate) v: &'a [L; N],
}

impl<L: Lanes, const N: usize> HandTask<L, N> {
    pub(crate) fn new(dims: usize, arm: &Robot, period_s: f64) -> Self {
        let zero = L::splat(0.0);
        Self {
            dims,
            kp: [zero; MOTION],
            kd: [zero; MOTION],
            kn: zero,
            dn: zero,
            singular: L::splat(-1.0),
            mount: Mount::new(&arm.kinematics, arm.gravity),
            turning: L::splat(if dims == MOTION { 1.0 } else { 0.0 }),
            measured: NearTurns::none(),
            wanted: NearTurns::none(),
            stride: whole(NEAR_S / period_s).max(1),
            scratch: Scratch::new(),
        }
    }

    /// Whether the controllers move the hand, and not single joints.
    pub(crate) fn is_of_hand(&self) -> bool {
        self.dims > 0
    }

    pub(crate) fn set_lane(&mut self, lane: usize, gains: &Gains) {
        for row in 0..self.dims {
            self.kp[row].set_lane(lane, gains.kp[row]);
            self.kd[row].set_lane(lane, gains.kd[row]);
        }
        self.kn.set_lane(lane, gains.kn.unwrap_or_default());
        self.dn.set_lane(lane, gains.dn.unwrap_or_default());
        self.singular.set_lane(lane, -1.0);
    }

    /// Above 0 where the posture was singular since the last call.
    #[inline(always)]
    pub(crate) fn take_singular(&mut self) -> L {
        std::mem::replace(&mut self.singular, L::splat(-1.0))
    }

    /// Looks at the turns of all joints, often enough for the periods in between.
    #[inline(always)]
    pub(crate) fn look<S: Structure<N>>(
        &mut self,
        structure: S,
        known: &Model<L, N>,
        period: usize,
        moment: &Moment<'_, L, N>,
    ) {
        if period.is_multiple_of(self.stride) {
            let Self { measured, wanted, .. } = self;
            for (q, near) in [(moment.q, measured), (moment.r, wanted)] {
                L::run(TurnsAt { structure, model: known, q, near });
            }
        }
    }

    /// kp e + kd (ẋ_r − ẋ).
    #[inline(always)]
    fn pull(
        &self,
        wanted: &HandMotion<'_, L, N>,
        posture: &Posture<'_, L, N>,
        velocity: &[L; MOTION],
    ) -> [L; MOTION] {
        let (error, wanted) = (posture.error(wanted), wanted.velocity());
        let mut pull = error;
        for row in 0..MOTION {
            let slower = wanted[row] - velocity[row];
            pull[row] = self.kp[row].mul_add(error[row], self.kd[row] * slower);
        }
        pull
    }

    /// kn (r − q) + dn (ṙ − v) of each joint.
    #[inline(always)]
    fn keep_posture(&self, joints: usize, moment: &Moment<'_, L, N>) -> [L; N] {
        let Moment { r, rd, q, v, .. } = moment;
        let mut kept = [L::splat(0.0); N];
        for joint in 0..joints {
            let slower = self.dn * (rd[joint] - v[joint]);
            kept[joint] = self.kn.mul_add(r[joint] - q[joint], slower);
        }
        kept
    }
}

/// The torques of `operational-space`.
pub(crate) struct MoveHand<'a, S, L, const N: usize> {
    pub(crate) structure: S,
    pub(crate) task: &'a mut HandTask<L, N>,
    /// The nominal arm.
    pub(crate) known: &'a Model<L, N>,
    pub(crate) moment: Moment<'a, L, N>,
    pub(crate) command: &'a mut [L; N],
}

impl<L: Lanes, S: Structure<N>, const N: usize> Kernel<L> for MoveHand<'_, S, L, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        align_stack();
        let Self { structure, task, known, moment, command } = self;
        let joints = structure.joints();
        let mut kept = task.keep_posture(joints, &moment);
        for joint in 0..joints {
            kept[joint] = kept[joint] + moment.rdd[joint];
        }
        let turns = task.measured.at(joints, moment.q);
        let posture = Posture::of(structure, known, &task.mount, &turns);
        posture.write_jacobian(joints, task.turning, &mut task.scratch.jacobian);
        let dynamics = structure.inverse_dynamics(known, &turns, moment.v, &kept);
        let matrix = task.scratch.compliance(joints, &dynamics.mass);
        let factors = Factors::of(matrix, task.turning, LEAST_PIVOT);
        task.singular = task.singular.max(factors.singular);

        let turns = task.wanted.at(joints, moment.r);
        let wanted = JointMotion { turns: &turns, qd: moment.rd, qdd: moment.rdd };
        let wanted = HandMotion::of(structure, known, &task.mount, wanted);
        let mut force =
            task.pull(&wanted, &posture, &task.scratch.jacobian.times(joints, moment.v));
        let link = &dynamics.last_link;
        let at_hand = link.acceleration_at(&task.mount.hand);
        let given = posture.acceleration([&at_hand, &link.angular_acceleration], &task.mount);
        let wanted = wanted.acceleration();
        for row in 0..MOTION {
            force[row] = force[row] + (wanted[row] - given[row]);
        }
        factors.solve(&mut force);
        *command = dynamics.torque;
        task.scratch.jacobian.add_force(joints, &force, command);
    }
}

/// The torques of `cartesian-impedance`.
pub(crate) struct PushHand<'a, S, L, const N: usize> {
    pub(crate) structure: S,
    pub(crate) task: &'a mut HandTask<L, N>,
    /// The nominal arm.
    pub(crate) known: &'a Model<L, N>,
    pub(crate) moment: Moment<'a, L, N>,
    pub(crate) command: &'a mut [L; N],
}

impl<L: Lanes, S: Structure<N>, const N: usize> Kernel<L> for PushHand<'_, S, L, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        align_stack();
        let Self { structure, task, known, moment, command } = self;
        let joints = structure.joints();
        let turns = task.measured.at(joints, moment.q);
        let posture = Posture::of(structure, known, &task.mount, &turns);
        posture.write_jacobian(joints, task.turning, &mut task.scratch.jacobian);
        structure.gravity(known, &turns, command);

        let turns = task.wanted.at(joints, moment.r);
        let wanted = JointMotion { turns: &turns, qd: moment.rd, qdd: moment.rdd };
        let wanted = HandMotion::of(structure, known, &task.mount, wanted);
        let mut force =
            task.pull(&wanted, &posture, &task.scratch.jacobian.times(joints, moment.v));
        if joints > task.dims {
            let kept = task.keep_posture(joints, &moment);
            let mut pushed = task.scratch.jacobian.times(joints, &kept);
            let matrix = task.scratch.gram(joints);
            let factors = Factors::of(matrix, task.turning, LEAST_PIVOT);
            task.singular = task.singular.max(factors.singular);
            factors.solve(&mut pushed);
            for row in 0..MOTION {
                force[row] = force[row] - pushed[row];
            }
            for joint in 0..joints {
                command[joint] = command[joint] + kept[joint];
            }
        }
        task.scratch.jacobian.add_force(joints, &force, command);
    }
}
