//! The structure of any chain of revolute joints. Each robot has its own twists, origins and
//! offsets, and any direction of gravity.
//!
//! The algorithms are those of [`crate::forward_dynamics`], in loops over the joints of the arm.
//! Links are regrouped as well. The remainder of the first link needs no mass either, since the
//! base does not move.

use simd::Lanes;
use spec::MAX_JOINTS;

use crate::forward_dynamics::{
    Composite, Dynamics, FactoredMass, InverseDynamics, Motion, Wrench, moment_at_rest,
};
use crate::hand::{Place, Tilt, Walker};
use crate::model::Model;
use crate::spatial::{Symmetric, Turn, Vector, add_cross, sum};
use crate::structure::Structure;

/// An arm of any structure. Arrays shorter than [`MAX_JOINTS`] are full. For them loops have a
/// constant length and are faster. Their arithmetic is the same.
#[derive(Clone, Copy)]
pub(crate) struct General<const N: usize> {
    joints: usize,
}

impl<const N: usize> General<N> {
    pub(crate) fn new(joints: usize) -> Self {
        Self { joints }
    }

    /// [`Structure::mass_matrix_and_bias`] with accelerations of the joints. Armature does not
    /// count among their forces.
    #[inline(always)]
    fn equation_of_motion<L: Lanes>(
        self,
        model: &Model<L, N>,
        turns: &[Turn<L>; N],
        qd: &[L; N],
        qdd: Option<&[L; N]>,
        dynamics: &mut Dynamics<L, N>,
    ) -> Motion<L> {
        let joints = Structure::<N>::joints(self);
        let mut wrenches = [Wrench::zero(); N];
        let mut motion = Motion::of_base(model.base_acceleration);
        for joint in 0..joints {
            motion = motion.beyond(place(model, turns, joint), qd[joint]);
            if let Some(qdd) = qdd {
                motion = motion.accelerated(qdd[joint]);
            }
            wrenches[joint] = motion.wrench(&model.links[joint]);
        }
        let last_link = motion;

        let mut columns = [Wrench::zero(); N];
        let last = joints - 1;
        let mut composite = Composite::of_last_link(&model.links[last]);
        let mut wrench = wrenches[last];
        let mut joint = last;
        loop {
            columns[joint] = composite.wrench_of_unit_acceleration();
            dynamics.mass_matrix[joint][joint] = columns[joint].moment[2] + model.armature[joint];
            dynamics.bias[joint] = wrench.moment[2];
            if joint == 0 {
                return last_link;
            }
            let place = place(model, turns, joint);
            let parent = joint - 1;
            for column in joint..joints {
                columns[column] = place.wrench_to_parent(columns[column]);
                dynamics.mass_matrix[column][parent] = columns[column].moment[2];
            }
            let first_moment = place.to_parent(composite.first_moment);
            let inertia = place.symmetric_to_parent(composite.inertia);
            let inertia = shifted(place.origin, first_moment, inertia);
            composite = Composite { first_moment, inertia }.with_link(&model.links[parent]);
            wrench = place.wrench_to_parent(wrench).plus(wrenches[parent]);
            joint = parent;
        }
    }
}

/// The position and orientation of a joint's frame in the frame of the link before it.
#[derive(Clone, Copy)]
struct JointPlacement<L> {
    origin: Vector<L>,
    /// The turn about x.
    twist: Turn<L>,
    /// The turn about z.
    turn: Turn<L>,
}

impl<L: Lanes> JointPlacement<L> {
    /// A vector of the joint's link, in the parent's axes.
    #[inline(always)]
    fn to_parent(self, [x, y, z]: Vector<L>) -> Vector<L> {
        let Self { twist, turn, .. } = self;
        let turned_x = turn.sin.neg_mul_add(y, turn.cos * x);
        let turned_y = turn.sin.mul_add(x, turn.cos * y);
        [
            turned_x,
            twist.sin.neg_mul_add(z, twist.cos * turned_y),
            twist.sin.mul_add(turned_y, twist.cos * z),
        ]
    }

    /// A vector of the parent, in the axes of the joint's link.
    #[inline(always)]
    fn to_child(self, [x, y, z]: Vector<L>) -> Vector<L> {
        let Self { twist, turn, .. } = self;
        let turned_y = twist.sin.mul_add(z, twist.cos * y);
        let turned_z = twist.sin.neg_mul_add(y, twist.cos * z);
        [
            turn.sin.mul_add(turned_y, turn.cos * x),
            turn.sin.neg_mul_add(x, turn.cos * turned_y),
            turned_z,
        ]
    }

    /// A symmetric matrix of the joint's link, in the parent's axes: R A Rᵀ.
    #[inline(always)]
    fn symmetric_to_parent(self, [xx, xy, xz, yy, yz, zz]: Symmetric<L>) -> Symmetric<L> {
        let Self { twist, turn, .. } = self;
        let ([xx, xy, yy], [xz, yz]) = turned(turn, [xx, xy, yy], [xz, yz]);
        // Here y and z are turned about x. They take the place that x and y have for a turn about
        // z.
        let ([yy, yz, zz], [xy, xz]) = turned(twist, [yy, yz, zz], [xy, xz]);
        [xx, xy, xz, yy, yz, zz]
    }

    #[inline(always)]
    fn wrench_to_parent(self, wrench: Wrench<L>) -> Wrench<L> {
        let force = self.to_parent(wrench.force);
        let moment = self.to_parent(wrench.moment);
        Wrench { force, moment: add_cross(self.origin, force, moment) }
    }
}

/// A symmetric matrix turned about an axis: its block across the axis (entries 11, 12, 22) and its
/// entries between the block and the axis (1, 2).
#[inline(always)]
fn turned<L: Lanes>(turn: Turn<L>, block: [L; 3], mixed: [L; 2]) -> ([L; 3], [L; 2]) {
    let Turn { sin, cos } = turn;
    let [a, b, c] = block;
    let first = sin.neg_mul_add(b, cos * a);
    let second = sin.neg_mul_add(c, cos * b);
    let turned_a = sin.neg_mul_add(second, cos * first);
    let turned_b = cos.mul_add(second, sin * first);
    // The trace of the turned block is that of the block.
    let turned_c = (a + c) - turned_a;
    let [p, q] = mixed;
    ([turned_a, turned_b, turned_c], [sin.neg_mul_add(q, cos * p), cos.mul_add(q, sin * p)])
}

/// Inertia about the parent's origin of a massless body whose inertia about the joint's is given:
/// I − [t][h] − [h][t] with t the joint's origin and h the first moment.
#[inline(always)]
fn shifted<L: Lanes>(t: Vector<L>, h: Vector<L>, inertia: Symmetric<L>) -> Symmetric<L> {
    let [xx, xy, xz, yy, yz, zz] = inertia;
    let twice = [h[0] + h[0], h[1] + h[1], h[2] + h[2]];
    let [x, y, z] = [0, 1, 2];
    [
        t[y].mul_add(twice[y], t[z].mul_add(twice[z], xx)),
        t[x].neg_mul_add(h[y], t[y].neg_mul_add(h[x], xy)),
        t[x].neg_mul_add(h[z], t[z].neg_mul_add(h[x], xz)),
        t[x].mul_add(twice[x], t[z].mul_add(twice[z], yy)),
        t[y].neg_mul_add(h[z], t[z].neg_mul_add(h[y], yz)),
        t[x].mul_add(twice[x], t[y].mul_add(twice[y], zz)),
    ]
}

impl<L: Lanes> Motion<L> {
    /// The base. It does not move, but it accelerates upwards against free fall.
    #[inline(always)]
    fn of_base(base_acceleration: Vector<L>) -> Self {
        let zero = [L::splat(0.0); 3];
        Self::new(zero, zero, base_acceleration)
    }

    /// The motion of the link behind a joint, from that of the link before it.
    #[inline(always)]
    fn beyond(&self, place: JointPlacement<L>, qd: L) -> Self {
        let acceleration = self.acceleration_at(&place.origin);
        let mut w = place.to_child(self.angular_velocity);
        let mut w_dot = place.to_child(self.angular_acceleration);
        w_dot[0] = w[1].mul_add(qd, w_dot[0]);
        w_dot[1] = w[0].neg_mul_add(qd, w_dot[1]);
        w[2] = w[2] + qd;
        Self::new(w, w_dot, place.to_child(acceleration))
    }
}

impl<const N: usize> Structure<N> for General<N> {
    #[inline(always)]
    fn joints(self) -> usize {
        if N < MAX_JOINTS {
            return N;
        }
        // This tells the compiler that no index is out of bounds.
        self.joints.min(N)
    }

    #[inline(always)]
    fn turns<L: Lanes>(self, model: &Model<L, N>, q: &[L; N], turns: &mut [Turn<L>; N]) {
        for joint in 0..self.joints() {
            turns[joint] = Turn::by(q[joint]).and(model.offsets[joint]);
        }
    }

    #[inline(always)]
    fn all_turns<L: Lanes>(self, model: &Model<L, N>, q: &[L; N], turns: &mut [Turn<L>; N]) {
        self.turns(model, q, turns);
    }

    #[inline(always)]
    fn later_turns<L: Lanes>(
        self,
        start: &[Turn<L>; N],
        change: &[L; N],
        turns: &mut [Turn<L>; N],
    ) {
        for joint in 0..self.joints() {
            turns[joint] = start[joint].followed_by(change[joint]);
        }
    }

    #[inline(always)]
    fn mass_matrix_and_bias<L: Lanes>(
        self,
        model: &Model<L, N>,
        turns: &[Turn<L>; N],
        qd: &[L; N],
        dynamics: &mut Dynamics<L, N>,
    ) {
        self.equation_of_motion(model, turns, qd, None, dynamics);
    }

    #[inline(always)]
    fn inverse_dynamics<L: Lanes>(
        self,
        model: &Model<L, N>,
        turns: &[Turn<L>; N],
        qd: &[L; N],
        qdd: &[L; N],
    ) -> InverseDynamics<L, N> {
        let mut equation = Dynamics::zero();
        let last_link = self.equation_of_motion(model, turns, qd, Some(qdd), &mut equation);
        let mut torque = equation.bias;
        for joint in 0..self.joints() {
            torque[joint] = model.armature[joint].mul_add(qdd[joint], equation.bias[joint]);
        }
        let mut matrix = equation.mass_matrix;
        let (mut factors, mut inverse_pivots) = (matrix, torque);
        for pivot in (0..self.joints()).rev() {
            inverse_pivots[pivot] = matrix[pivot][pivot].recip();
            for row in 0..pivot {
                let factor = matrix[pivot][row] * inverse_pivots[pivot];
                for column in 0..=row {
                    matrix[row][column] =
                        factor.neg_mul_add(matrix[pivot][column], matrix[row][column]);
                }
                factors[pivot][row] = factor;
            }
        }
        InverseDynamics { torque, mass: FactoredMass { factors, inverse_pivots }, last_link }
    }

    #[inline(always)]
    fn gravity<L: Lanes>(self, model: &Model<L, N>, turns: &[Turn<L>; N], gravity: &mut [L; N]) {
        let joints = self.joints();
        let mut moments = [[L::splat(0.0); 3]; N];
        let mut acceleration = model.base_acceleration;
        for joint in 0..joints {
            acceleration = place(model, turns, joint).to_child(acceleration);
            moments[joint] = moment_at_rest(&model.links[joint], acceleration);
        }
        let mut moment = moments[joints - 1];
        for joint in (1..joints).rev() {
            gravity[joint] = moment[2];
            moment = place(model, turns, joint).to_parent(moment);
            moment = sum(moment, moments[joint - 1]);
        }
        gravity[0] = moment[2];
    }

    #[inline(always)]
    fn walk<L: Lanes>(self, model: &Model<L, N>, walker: &mut impl Walker<L>) {
        for joint in 0..self.joints() {
            let (origin, tilt) = (model.origins[joint], Tilt::By(model.twists[joint]));
            walker.pass(joint, &Place { origin, shifted: [true; 3], tilt });
        }
    }

    #[inline(always)]
    fn solve<L: Lanes>(self, m: &mut [[L; N]; N], b: &mut [L; N], qdd: &mut [L; N]) {
        let joints = self.joints();
        let mut inverse_pivots = [L::splat(0.0); N];
        for pivot in (0..joints).rev() {
            inverse_pivots[pivot] = m[pivot][pivot].recip();
            for row in 0..pivot {
                let factor = m[pivot][row] * inverse_pivots[pivot];
                for column in 0..=row {
                    m[row][column] = factor.neg_mul_add(m[pivot][column], m[row][column]);
                }
                b[row] = factor.neg_mul_add(b[pivot], b[row]);
            }
        }
        for joint in 0..joints {
            let mut rest = b[joint];
            for inner in 0..joint {
                rest = m[joint][inner].neg_mul_add(qdd[inner], rest);
            }
            qdd[joint] = rest * inverse_pivots[joint];
        }
    }
}

#[inline(always)]
fn place<L: Lanes, const N: usize>(
    model: &Model<L, N>,
    turns: &[Turn<L>; N],
    joint: usize,
) -> JointPlacement<L> {
    JointPlacement { origin: model.origins[joint], twist: model.twists[joint], turn: turns[joint] }
}
