//! The motion of the hand: its pose, velocity, acceleration and Jacobian, and the torques of
//! controllers whose task it is.
//!
//! Vectors are in the world's axes. A motion has the hand's velocity first and its turning second.

use simd::{Kernel, Lanes, align_stack};
use spec::MAX_JOINTS;

use crate::kinematics::Kinematics;
use crate::spatial::{Turn, Vector, add_cross, sum};

/// Numbers of the motion of a hand.
pub(crate) const MOTION: usize = 6;

/// A task is singular where a pivot of its matrix is below this share of the entry that it comes
/// from: two directions in which the hand moves are almost one.
const LEAST_PIVOT: f64 = 1e-4;

/// The motion of a hand, one per lane.
#[derive(Clone, Copy)]
pub(crate) struct Hand<L, const N: usize> {
    /// m.
    position: Vector<L>,
    axes: [Vector<L>; 3],
    /// m/s and rad/s.
    pub(crate) velocity: [L; MOTION],
    /// m/s² and rad/s².
    pub(crate) acceleration: [L; MOTION],
    /// A column per joint.
    pub(crate) jacobian: [[L; MOTION]; N],
}

impl<L: Lanes, const N: usize> Hand<L, N> {
    pub(crate) fn zero() -> Self {
        let zero = [L::splat(0.0); 3];
        let motion = [L::splat(0.0); MOTION];
        Self {
            position: zero,
            axes: [zero; 3],
            velocity: motion,
            acceleration: motion,
            jacobian: [motion; N],
        }
    }

    /// The displacement and the small turn from this pose to `other`.
    #[inline(always)]
    pub(crate) fn error(&self, other: &Self) -> [L; MOTION] {
        let mut turn = [L::splat(0.0); 3];
        for axis in 0..3 {
            turn = add_cross(self.axes[axis], other.axes[axis], turn);
        }
        let half = L::splat(0.5);
        let [from, to] = [self.position, other.position];
        [
            to[0] - from[0],
            to[1] - from[1],
            to[2] - from[2],
            half * turn[0],
            half * turn[1],
            half * turn[2],
        ]
    }
}

/// The motion of the hand of `arm` at positions `q`, velocities `qd` and accelerations `qdd` of its
/// joints.
pub(crate) struct HandOf<'a, L, const N: usize> {
    pub(crate) arm: &'a Kinematics,
    pub(crate) q: &'a [L; N],
    pub(crate) qd: &'a [L; N],
    pub(crate) qdd: &'a [L; N],
    pub(crate) hand: &'a mut Hand<L, N>,
}

impl<L: Lanes, const N: usize> Kernel<L> for HandOf<'_, L, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        align_stack();
        let Self { arm, q, qd, qdd, hand } = self;
        let zero = L::splat(0.0);
        let mut frame = Frame::base(arm);
        let mut origins = [[zero; 3]; MAX_JOINTS];
        let mut joint_axes = [[zero; 3]; MAX_JOINTS];
        for joint in 0..arm.joints.len() {
            let row = &arm.joints[joint];
            frame.shift(row.origin());
            frame.twist(row.twist.sin, row.twist.cos);
            origins[joint] = frame.position;
            joint_axes[joint] = frame.axes[2];
            let offset = Turn { sin: L::splat(row.offset.sin), cos: L::splat(row.offset.cos) };
            frame.turn(Turn::by(q[joint]).and(offset));
            frame.turn_on(qd[joint], qdd[joint]);
        }
        let row = &arm.hand;
        frame.shift(row.origin());
        frame.twist(row.twist.sin, row.twist.cos);
        frame.turn(Turn { sin: L::splat(row.offset.sin), cos: L::splat(row.offset.cos) });

        hand.position = frame.position;
        hand.axes = frame.axes;
        for axis in 0..3 {
            hand.velocity[axis] = frame.velocity[axis];
            hand.velocity[3 + axis] = frame.turning[axis];
            hand.acceleration[axis] = frame.acceleration[axis];
            hand.acceleration[3 + axis] = frame.turning_faster[axis];
        }
        for joint in 0..arm.joints.len() {
            let [origin, axis] = [origins[joint], joint_axes[joint]];
            let mut arm = frame.position;
            for coordinate in 0..3 {
                arm[coordinate] = arm[coordinate] - origin[coordinate];
            }
            let linear = add_cross(axis, arm, [zero; 3]);
            hand.jacobian[joint] = [linear[0], linear[1], linear[2], axis[0], axis[1], axis[2]];
        }
    }
}

/// A frame that moves, in the world.
struct Frame<L> {
    position: Vector<L>,
    /// Its axes x, y and z.
    axes: [Vector<L>; 3],
    velocity: Vector<L>,
    turning: Vector<L>,
    acceleration: Vector<L>,
    turning_faster: Vector<L>,
}

impl<L: Lanes> Frame<L> {
    #[inline(always)]
    fn base(arm: &Kinematics) -> Self {
        let zero = [L::splat(0.0); 3];
        let mut axes = [zero; 3];
        for row in 0..3 {
            for column in 0..3 {
                axes[column][row] = L::splat(arm.base.rotation[row][column]);
            }
        }
        let mut position = zero;
        for axis in 0..3 {
            position[axis] = L::splat(arm.base.position_m[axis]);
        }
        Self {
            position,
            axes,
            velocity: zero,
            turning: zero,
            acceleration: zero,
            turning_faster: zero,
        }
    }

    /// Shifts the frame along its own axes.
    #[inline(always)]
    fn shift(&mut self, origin: [f64; 3]) {
        let zero = [L::splat(0.0); 3];
        let mut shift = zero;
        for axis in 0..3 {
            if origin[axis] != 0.0 {
                let length = L::splat(origin[axis]);
                for coordinate in 0..3 {
                    shift[coordinate] =
                        length.mul_add(self.axes[axis][coordinate], shift[coordinate]);
                }
            }
        }
        let speed = add_cross(self.turning, shift, zero);
        self.acceleration = add_cross(self.turning_faster, shift, self.acceleration);
        self.acceleration = add_cross(self.turning, speed, self.acceleration);
        self.velocity = sum(self.velocity, speed);
        self.position = sum(self.position, shift);
    }

    /// Turns the frame about its x axis.
    #[inline(always)]
    fn twist(&mut self, sin: f64, cos: f64) {
        if sin == 0.0 && cos == 1.0 {
            return;
        }
        let (sin, cos) = (L::splat(sin), L::splat(cos));
        let [_, y, z] = self.axes;
        for coordinate in 0..3 {
            self.axes[1][coordinate] = sin.mul_add(z[coordinate], cos * y[coordinate]);
            self.axes[2][coordinate] = sin.neg_mul_add(y[coordinate], cos * z[coordinate]);
        }
    }

    /// Turns the frame about its z axis.
    #[inline(always)]
    fn turn(&mut self, Turn { sin, cos }: Turn<L>) {
        let [x, y, _] = self.axes;
        for coordinate in 0..3 {
            self.axes[0][coordinate] = sin.mul_add(y[coordinate], cos * x[coordinate]);
            self.axes[1][coordinate] = sin.neg_mul_add(x[coordinate], cos * y[coordinate]);
        }
    }

    /// Lets the frame turn about its z axis, ever faster.
    #[inline(always)]
    fn turn_on(&mut self, speed: L, acceleration: L) {
        let mut turning = self.axes[2];
        for coordinate in 0..3 {
            self.turning_faster[coordinate] =
                acceleration.mul_add(turning[coordinate], self.turning_faster[coordinate]);
            turning[coordinate] = speed * turning[coordinate];
        }
        self.turning_faster = add_cross(self.turning, turning, self.turning_faster);
        self.turning = sum(self.turning, turning);
    }
}

/// Factors of a symmetric positive definite matrix: L D Lᵀ, with ones on the diagonal of L.
#[derive(Clone, Copy)]
pub(crate) struct Factors<L, const K: usize> {
    lower: [[L; K]; K],
    /// 1 / D.
    inverse: [L; K],
    /// Above 0 where the matrix is singular.
    pub(crate) singular: L,
}

impl<L: Lanes, const K: usize> Factors<L, K> {
    /// The factors of the first `count` rows and columns of `matrix`, which is given on and below
    /// the diagonal.
    #[inline(always)]
    pub(crate) fn of(matrix: &[[L; K]; K], count: usize) -> Self {
        let zero = L::splat(0.0);
        let mut factors = Self { lower: *matrix, inverse: [zero; K], singular: L::splat(-1.0) };
        let mut scaled = [[zero; K]; K];
        for row in 0..count {
            for column in 0..row {
                let mut entry = factors.lower[row][column];
                for earlier in 0..column {
                    entry = scaled[row][earlier].neg_mul_add(factors.lower[column][earlier], entry);
                }
                scaled[row][column] = entry;
                factors.lower[row][column] = entry * factors.inverse[column];
            }
            let mut pivot = factors.lower[row][row];
            for earlier in 0..row {
                pivot = scaled[row][earlier].neg_mul_add(factors.lower[row][earlier], pivot);
            }
            let least = matrix[row][row] * L::splat(LEAST_PIVOT);
            factors.singular = factors.singular.max(least - pivot);
            // A singular lane is noticed at the next sample. Until then its numbers stay finite.
            factors.inverse[row] =
                pivot.max(least.max(L::splat(f64::from(f32::MIN_POSITIVE)))).recip();
        }
        factors
    }

    /// `b` becomes L⁻¹ b.
    #[inline(always)]
    fn forward(&self, count: usize, b: &mut [L; K]) {
        for row in 0..count {
            for column in 0..row {
                b[row] = self.lower[row][column].neg_mul_add(b[column], b[row]);
            }
        }
    }

    /// `b` becomes the solution of the equations with this matrix.
    #[inline(always)]
    pub(crate) fn solve(&self, count: usize, b: &mut [L; K]) {
        self.forward(count, b);
        for row in (0..count).rev() {
            b[row] = b[row] * self.inverse[row];
            for later in row + 1..count {
                b[row] = self.lower[later][row].neg_mul_add(b[later], b[row]);
            }
        }
    }
}

/// J M⁻¹ Jᵀ on and below the diagonal, of the first `dims` rows of the Jacobian: how much the hand
/// gives way to a force. `mass` has M on and below the diagonal.
#[inline(always)]
pub(crate) fn compliance<L: Lanes, const N: usize>(
    joints: usize,
    dims: usize,
    jacobian: &[[L; MOTION]; N],
    mass: &[[L; N]; N],
) -> [[L; MOTION]; MOTION] {
    let zero = L::splat(0.0);
    let factors = Factors::of(mass, joints);
    let mut rows = [[zero; N]; MOTION];
    for row in 0..dims {
        for joint in 0..joints {
            rows[row][joint] = jacobian[joint][row];
        }
        factors.forward(joints, &mut rows[row]);
    }
    let mut matrix = [[zero; MOTION]; MOTION];
    for joint in 0..joints {
        for row in 0..dims {
            let weighted = rows[row][joint] * factors.inverse[joint];
            for column in 0..=row {
                matrix[row][column] = weighted.mul_add(rows[column][joint], matrix[row][column]);
            }
        }
    }
    matrix
}

/// J Jᵀ on and below the diagonal, of the first `dims` rows of the Jacobian.
#[inline(always)]
pub(crate) fn gram<L: Lanes, const N: usize>(
    joints: usize,
    dims: usize,
    jacobian: &[[L; MOTION]; N],
) -> [[L; MOTION]; MOTION] {
    let mut matrix = [[L::splat(0.0); MOTION]; MOTION];
    for joint in 0..joints {
        let column_of_joint = &jacobian[joint];
        for row in 0..dims {
            for column in 0..=row {
                matrix[row][column] =
                    column_of_joint[row].mul_add(column_of_joint[column], matrix[row][column]);
            }
        }
    }
    matrix
}

/// J x: the hand's motion that velocities or accelerations `x` of the joints give.
#[inline(always)]
pub(crate) fn of_hand<L: Lanes, const N: usize>(
    joints: usize,
    jacobian: &[[L; MOTION]; N],
    x: &[L; N],
) -> [L; MOTION] {
    let mut motion = [L::splat(0.0); MOTION];
    for joint in 0..joints {
        for row in 0..MOTION {
            motion[row] = jacobian[joint][row].mul_add(x[joint], motion[row]);
        }
    }
    motion
}

/// `sum` + Jᵀ f: the torques that hold a force `f` of the hand, of its first `dims` numbers.
#[inline(always)]
pub(crate) fn add_force<L: Lanes, const N: usize>(
    joints: usize,
    dims: usize,
    jacobian: &[[L; MOTION]; N],
    force: &[L; MOTION],
    sum: &mut [L; N],
) {
    for joint in 0..joints {
        for row in 0..dims {
            sum[joint] = jacobian[joint][row].mul_add(force[row], sum[joint]);
        }
    }
}
