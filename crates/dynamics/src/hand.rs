//! The hand of the nominal arm: its pose, velocity, acceleration and Jacobian.
//!
//! Vectors are in the world's axes, and positions are from the first joint. A motion has the
//! hand's velocity first and its turning second. Only differences of two poses matter, and those do
//! not depend on how the hand is turned in the last link.

use simd::{Kernel, Lanes};

use crate::kinematics::Kinematics;
use crate::model::Model;
use crate::spatial::{Turn, Vector, add_cross, sum};
use crate::structure::Structure;

/// Numbers of the motion of a hand.
pub(crate) const MOTION: usize = 6;

/// Where an arm is mounted, and where its hand is on the last link.
#[derive(Clone, Copy)]
pub(crate) struct Mount<L> {
    /// The axes x, y and z of the frame before the first joint.
    base: [Vector<L>; 3],
    /// The hand's origin in the last link's frame, m.
    pub(crate) hand: Vector<L>,
    /// Acceleration of the base that is felt like gravity, m/s².
    gravity: Vector<L>,
}

impl<L: Lanes> Mount<L> {
    pub(crate) fn new(arm: &Kinematics, gravity: f64) -> Self {
        let mut base = [[L::splat(0.0); 3]; 3];
        for row in 0..3 {
            for column in 0..3 {
                base[column][row] = L::splat(arm.base.rotation[row][column]);
            }
        }
        let hand = arm.hand.origin().map(L::splat);
        Self { base, hand, gravity: [0.0, 0.0, gravity].map(L::splat) }
    }
}

/// The turn of a joint's frame about x of the frame before.
#[derive(Clone, Copy)]
pub(crate) enum Tilt<L> {
    None,
    /// +90°.
    Quarter,
    /// −90°.
    MinusQuarter,
    By(Turn<L>),
}

/// The place of a joint in the frame before it.
#[derive(Clone, Copy)]
pub(crate) struct Place<L> {
    pub(crate) origin: Vector<L>,
    /// Whether a coordinate of the origin may differ from 0.
    pub(crate) shifted: [bool; 3],
    pub(crate) tilt: Tilt<L>,
}

/// Something that moves along an arm, from the first joint to the last.
pub(crate) trait Walker<L> {
    fn pass(&mut self, joint: usize, place: &Place<L>);
}

/// The axes x, y and z of a frame.
#[derive(Clone, Copy)]
pub(crate) struct Axes<L>(pub(crate) [Vector<L>; 3]);

impl<L: Lanes> Axes<L> {
    /// A vector of the frame, in the world.
    #[inline(always)]
    fn in_world(&self, vector: &Vector<L>, used: [bool; 3]) -> Vector<L> {
        let mut world = [L::splat(0.0); 3];
        let mut empty = true;
        for axis in 0..3 {
            if used[axis] {
                for coordinate in 0..3 {
                    let part = self.0[axis][coordinate];
                    world[coordinate] = if empty {
                        vector[axis] * part
                    } else {
                        vector[axis].mul_add(part, world[coordinate])
                    };
                }
                empty = false;
            }
        }
        world
    }

    /// Turns the frame about its x axis.
    #[inline(always)]
    fn tilt(&mut self, tilt: Tilt<L>) {
        let [x, y, z] = self.0;
        self.0 = match tilt {
            Tilt::None => [x, y, z],
            Tilt::Quarter => [x, z, negative(y)],
            Tilt::MinusQuarter => [x, negative(z), y],
            Tilt::By(turn) => {
                let (y, z) = turned(turn, y, z);
                [x, y, z]
            }
        };
    }

    /// Turns the frame about its z axis.
    #[inline(always)]
    fn turn(&mut self, turn: Turn<L>) {
        let [x, y, z] = self.0;
        let (x, y) = turned(turn, x, y);
        self.0 = [x, y, z];
    }
}

/// Two orthogonal axes after a turn from the first to the second.
#[inline(always)]
fn turned<L: Lanes>(
    Turn { sin, cos }: Turn<L>,
    first: Vector<L>,
    second: Vector<L>,
) -> (Vector<L>, Vector<L>) {
    let (mut new_first, mut new_second) = (first, second);
    for coordinate in 0..3 {
        new_first[coordinate] = sin.mul_add(second[coordinate], cos * first[coordinate]);
        new_second[coordinate] = sin.neg_mul_add(first[coordinate], cos * second[coordinate]);
    }
    (new_first, new_second)
}

#[inline(always)]
fn negative<L: Lanes>([x, y, z]: Vector<L>) -> Vector<L> {
    [-x, -y, -z]
}

/// The hand's pose at given turns of the joints, and the axes of all joints.
#[derive(Clone, Copy)]
pub(crate) struct Posture<'a, L, const N: usize> {
    turns: &'a [Turn<L>; N],
    position: Vector<L>,
    axes: Axes<L>,
    origins: [Vector<L>; N],
    joint_axes: [Vector<L>; N],
}

impl<L: Lanes, const N: usize> Walker<L> for Posture<'_, L, N> {
    #[inline(always)]
    fn pass(&mut self, joint: usize, place: &Place<L>) {
        if joint > 0 {
            self.position = sum(self.position, self.axes.in_world(&place.origin, place.shifted));
        }
        self.axes.tilt(place.tilt);
        self.origins[joint] = self.position;
        self.joint_axes[joint] = self.axes.0[2];
        self.axes.turn(self.turns[joint]);
    }
}

impl<'a, L: Lanes, const N: usize> Posture<'a, L, N> {
    #[inline(always)]
    pub(crate) fn of<S: Structure<N>>(
        structure: S,
        model: &Model<L, N>,
        mount: &Mount<L>,
        turns: &'a [Turn<L>; N],
    ) -> Self {
        let zero = [L::splat(0.0); 3];
        let mut posture = Self {
            turns,
            position: zero,
            axes: Axes(mount.base),
            origins: [zero; N],
            joint_axes: [zero; N],
        };
        structure.walk(model, &mut posture);
        posture.position = sum(posture.position, posture.axes.in_world(&mount.hand, [true; 3]));
        posture
    }

    /// Writes the Jacobian of this posture. Its last three rows are multiplied by `turning`.
    #[inline(always)]
    pub(crate) fn write_jacobian(&self, joints: usize, turning: L, jacobian: &mut Jacobian<L, N>) {
        let rows = &mut jacobian.rows;
        for joint in 0..joints {
            let [x, y, z] = self.joint_axes[joint];
            let mut arm = self.position;
            for coordinate in 0..3 {
                arm[coordinate] = arm[coordinate] - self.origins[joint][coordinate];
            }
            rows[0][joint] = z.neg_mul_add(arm[1], y * arm[2]);
            rows[1][joint] = x.neg_mul_add(arm[2], z * arm[0]);
            rows[2][joint] = y.neg_mul_add(arm[0], x * arm[1]);
            rows[3][joint] = turning * x;
            rows[4][joint] = turning * y;
            rows[5][joint] = turning * z;
        }
    }

    /// The displacement and the small turn from this pose to that of `other`.
    #[inline(always)]
    pub(crate) fn error(&self, other: &HandMotion<'_, L, N>) -> [L; MOTION] {
        self.error_to(&other.position, &other.axes)
    }

    /// The displacement and the small turn from this pose to another.
    #[inline(always)]
    pub(crate) fn error_to(&self, to: &Vector<L>, axes: &Axes<L>) -> [L; MOTION] {
        let half = L::splat(0.5);
        let mut turn = [L::splat(0.0); 3];
        for axis in 0..3 {
            turn = add_cross(self.axes.0[axis], axes.0[axis], turn);
        }
        let from = self.position;
        [
            to[0] - from[0],
            to[1] - from[1],
            to[2] - from[2],
            half * turn[0],
            half * turn[1],
            half * turn[2],
        ]
    }

    /// The acceleration of the hand in the world, from those in the last link's axes: of the hand
    /// minus that of free fall, and angular.
    #[inline(always)]
    pub(crate) fn acceleration(
        &self,
        [linear, angular]: [&Vector<L>; 2],
        mount: &Mount<L>,
    ) -> [L; MOTION] {
        let linear = self.axes.in_world(linear, [true; 3]);
        let angular = self.axes.in_world(angular, [true; 3]);
        let free = mount.gravity;
        [
            linear[0] - free[0],
            linear[1] - free[1],
            linear[2] - free[2],
            angular[0],
            angular[1],
            angular[2],
        ]
    }
}

/// The joints' motion that moves a hand.
#[derive(Clone, Copy)]
pub(crate) struct JointMotion<'a, L, const N: usize> {
    pub(crate) turns: &'a [Turn<L>; N],
    pub(crate) qd: &'a [L; N],
    pub(crate) qdd: &'a [L; N],
}

/// The pose of the hand, and how it moves.
pub(crate) struct HandMotion<'a, L, const N: usize> {
    joints: JointMotion<'a, L, N>,
    position: Vector<L>,
    axes: Axes<L>,
    linear_velocity: Vector<L>,
    angular_velocity: Vector<L>,
    linear_acceleration: Vector<L>,
    angular_acceleration: Vector<L>,
}

impl<L: Lanes, const N: usize> Walker<L> for HandMotion<'_, L, N> {
    #[inline(always)]
    fn pass(&mut self, joint: usize, place: &Place<L>) {
        // The first joint's frame stands still.
        if joint > 0 {
            self.shift(&place.origin, place.shifted);
        }
        self.axes.tilt(place.tilt);
        self.accelerate(joint);
        self.axes.turn(self.joints.turns[joint]);
    }
}

impl<'a, L: Lanes, const N: usize> HandMotion<'a, L, N> {
    #[inline(always)]
    pub(crate) fn of<S: Structure<N>>(
        structure: S,
        model: &Model<L, N>,
        mount: &Mount<L>,
        joints: JointMotion<'a, L, N>,
    ) -> Self {
        let zero = [L::splat(0.0); 3];
        let mut hand = Self {
            joints,
            position: zero,
            axes: Axes(mount.base),
            linear_velocity: zero,
            angular_velocity: zero,
            linear_acceleration: zero,
            angular_acceleration: zero,
        };
        structure.walk(model, &mut hand);
        hand.shift(&mount.hand, [true; 3]);
        hand
    }

    #[inline(always)]
    pub(crate) fn velocity(&self) -> [L; MOTION] {
        let ([x, y, z], [about_x, about_y, about_z]) =
            (self.linear_velocity, self.angular_velocity);
        [x, y, z, about_x, about_y, about_z]
    }

    #[inline(always)]
    pub(crate) fn acceleration(&self) -> [L; MOTION] {
        let ([x, y, z], [about_x, about_y, about_z]) =
            (self.linear_acceleration, self.angular_acceleration);
        [x, y, z, about_x, about_y, about_z]
    }

    /// Shifts the frame along its own axes.
    #[inline(always)]
    fn shift(&mut self, origin: &Vector<L>, shifted: [bool; 3]) {
        if shifted == [false; 3] {
            return;
        }
        let shift = self.axes.in_world(origin, shifted);
        let speed = add_cross(self.angular_velocity, shift, [L::splat(0.0); 3]);
        let linear = add_cross(self.angular_acceleration, shift, self.linear_acceleration);
        self.linear_acceleration = add_cross(self.angular_velocity, speed, linear);
        self.linear_velocity = sum(self.linear_velocity, speed);
        self.position = sum(self.position, shift);
    }

    /// Lets the frame turn about its z axis, ever faster.
    #[inline(always)]
    fn accelerate(&mut self, joint: usize) {
        let (qd, qdd) = (self.joints.qd[joint], self.joints.qdd[joint]);
        let axis = self.axes.0[2];
        let [mut turning, mut faster] = [axis; 2];
        for coordinate in 0..3 {
            turning[coordinate] = qd * axis[coordinate];
            faster[coordinate] =
                qdd.mul_add(axis[coordinate], self.angular_acceleration[coordinate]);
        }
        if joint == 0 {
            self.angular_velocity = turning;
            self.angular_acceleration = faster;
            return;
        }
        self.angular_acceleration = add_cross(self.angular_velocity, turning, faster);
        self.angular_velocity = sum(self.angular_velocity, turning);
    }
}

/// The Jacobian of a hand. Its number of joints is an argument of its methods, because a compiler that
/// knows it unrolls their loops.
pub(crate) struct Jacobian<L, const N: usize> {
    pub(crate) rows: [[L; N]; MOTION],
}

impl<L: Lanes, const N: usize> Jacobian<L, N> {
    pub(crate) fn zero() -> Self {
        Self { rows: [[L::splat(0.0); N]; MOTION] }
    }

    /// J x: the hand's motion that velocities `x` of the joints give.
    #[inline(always)]
    pub(crate) fn times(&self, joints: usize, x: &[L; N]) -> [L; MOTION] {
        let mut motion = [L::splat(0.0); MOTION];
        for row in 0..MOTION {
            motion[row] = self.rows[row][0] * x[0];
            for joint in 1..joints {
                motion[row] = self.rows[row][joint].mul_add(x[joint], motion[row]);
            }
        }
        motion
    }

    /// `sum` + Jᵀ f: the torques that hold a force `f` of the hand.
    #[inline(always)]
    pub(crate) fn add_force(&self, joints: usize, force: &[L; MOTION], sum: &mut [L; N]) {
        for row in 0..MOTION {
            for joint in 0..joints {
                sum[joint] = self.rows[row][joint].mul_add(force[row], sum[joint]);
            }
        }
    }
}

/// Turns of joints at a moment, from which those of the next moments follow.
pub(crate) struct NearTurns<L, const N: usize> {
    q: [L; N],
    turns: [Turn<L>; N],
}

impl<L: Lanes, const N: usize> NearTurns<L, N> {
    pub(crate) fn none() -> Self {
        Self { q: [L::splat(0.0); N], turns: [Turn::none(); N] }
    }

    /// The turns at `q`, a small change away.
    #[inline(always)]
    pub(crate) fn at(&self, joints: usize, q: &[L; N]) -> [Turn<L>; N] {
        let mut turns = self.turns;
        for joint in 0..joints {
            turns[joint] = turns[joint].followed_by(q[joint] - self.q[joint]);
        }
        turns
    }
}

/// Makes `near` the turns at `q`.
pub(crate) struct TurnsAt<'a, S, L, const N: usize> {
    pub(crate) structure: S,
    pub(crate) model: &'a Model<L, N>,
    pub(crate) q: &'a [L; N],
    pub(crate) near: &'a mut NearTurns<L, N>,
}

impl<L: Lanes, S: Structure<N>, const N: usize> Kernel<L> for TurnsAt<'_, S, L, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { structure, model, q, near } = self;
        near.q = *q;
        structure.all_turns(model, q, &mut near.turns);
    }
}
