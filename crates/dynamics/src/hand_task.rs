//! The task of controllers of the hand: the torques that move it, or push it, along a reference.

use simd::Lanes;

use crate::forward_dynamics::Dynamics;
use crate::hand::{self, Factors, Hand, HandOf, MOTION};
use crate::kinematics::Kinematics;
use crate::tracking::Gains;

/// The gains of controllers of the hand, and what they see of it. One robot per lane.
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
    /// The hand on the reference, and as it is measured.
    wanted: Hand<L, N>,
    hand: Hand<L, N>,
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
    pub(crate) fn new(dims: usize) -> Self {
        let zero = L::splat(0.0);
        Self {
            dims,
            kp: [zero; MOTION],
            kd: [zero; MOTION],
            kn: zero,
            dn: zero,
            singular: L::splat(-1.0),
            wanted: Hand::zero(),
            hand: Hand::zero(),
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

    /// Sees the hand of the nominal `arm`.
    #[inline(always)]
    pub(crate) fn see(&mut self, arm: &Kinematics, moment: &Moment<'_, L, N>) {
        let Moment { r, rd, rdd, q, v } = moment;
        let still = [L::splat(0.0); N];
        L::run(HandOf { arm, q: r, qd: rd, qdd: rdd, hand: &mut self.wanted });
        L::run(HandOf { arm, q, qd: v, qdd: &still, hand: &mut self.hand });
    }

    /// kp e + kd (ẋ_r − ẋ).
    #[inline(always)]
    fn pull(&self) -> [L; MOTION] {
        let Self { dims, kp, kd, wanted, hand, .. } = self;
        let mut pull = hand.error(wanted);
        for row in 0..*dims {
            let slower = wanted.velocity[row] - hand.velocity[row];
            pull[row] = kp[row].mul_add(pull[row], kd[row] * slower);
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

    /// The torques of `operational-space`. `dynamics` has the nominal arm's M, and C v + g.
    #[inline(always)]
    pub(crate) fn move_hand(
        &mut self,
        joints: usize,
        moment: &Moment<'_, L, N>,
        dynamics: &Dynamics<L, N>,
        command: &mut [L; N],
    ) {
        let mut kept = self.keep_posture(joints, moment);
        for joint in 0..joints {
            kept[joint] = kept[joint] + moment.rdd[joint];
        }
        let mut force = self.pull();
        let Self { dims, singular, wanted, hand, .. } = self;
        let given = hand::of_hand(joints, &hand.jacobian, &kept);
        for row in 0..*dims {
            let missing = wanted.acceleration[row] - hand.acceleration[row] - given[row];
            force[row] = force[row] + missing;
        }
        let mass = &dynamics.mass_matrix;
        let matrix = hand::compliance(joints, *dims, &hand.jacobian, mass);
        let factors = Factors::of(&matrix, *dims);
        *singular = singular.max(factors.singular);
        factors.solve(*dims, &mut force);
        for row in 0..joints {
            let mut torque = dynamics.bias[row];
            for column in 0..joints {
                // Only entries on and below the diagonal are set.
                let entry = mass[row.max(column)][row.min(column)];
                torque = entry.mul_add(kept[column], torque);
            }
            command[row] = torque;
        }
        hand::add_force(joints, *dims, &hand.jacobian, &force, command);
    }

    /// The torques of `cartesian-impedance` without gravity.
    #[inline(always)]
    pub(crate) fn push_hand(
        &mut self,
        joints: usize,
        moment: &Moment<'_, L, N>,
        command: &mut [L; N],
    ) {
        let mut force = self.pull();
        *command = [L::splat(0.0); N];
        if joints > self.dims {
            *command = self.keep_posture(joints, moment);
            let Self { dims, singular, hand, .. } = self;
            let mut of_posture = hand::of_hand(joints, &hand.jacobian, command);
            let factors = Factors::of(&hand::gram(joints, *dims, &hand.jacobian), *dims);
            *singular = singular.max(factors.singular);
            factors.solve(*dims, &mut of_posture);
            for row in 0..*dims {
                force[row] = force[row] - of_posture[row];
            }
        }
        hand::add_force(joints, self.dims, &self.hand.jacobian, &force, command);
    }
}
