//! (M + A) q̈ + C q̇ + g + D q̇ + τ_f(q̇) = u, solved for q̈.
//!
//! Mass matrix by the composite-rigid-body algorithm, bias forces by recursive Newton-Euler, both in
//! link frames and in one pass outwards and one inwards, then a factorization L D Lᵀ from the tip
//! (Featherstone 2008, "Rigid Body Dynamics Algorithms", chapters 5 and 6). With seven joints this
//! takes fewer operations than the articulated-body algorithm, and most of them are independent. Links
//! come with their inertias regrouped, see [`crate::model`], which leaves many of them zero.

use simd::Lanes;

use crate::compiled::{JOINTS, shifted};
use crate::model::{Link, Model};
use crate::spatial::{
    Symmetric, Turn, Vector, add_cross, add_matrix_origin, add_origin_cross, shifted_inertia, sum,
};
use crate::structure::Structure;

/// The equation of motion at one state.
#[derive(Clone, Copy)]
pub(crate) struct Dynamics<L, const N: usize> {
    /// M + A; only entries on and below the diagonal are set.
    pub(crate) mass_matrix: [[L; N]; N],
    /// C q̇ + g.
    pub(crate) bias: [L; N],
}

impl<L: Lanes, const N: usize> Dynamics<L, N> {
    #[inline(always)]
    pub(crate) fn zero() -> Self {
        let zero = L::splat(0.0);
        Self { mass_matrix: [[zero; N]; N], bias: [zero; N] }
    }
}

/// A mass matrix, factored from the last joint to the first.
pub(crate) struct FactoredMass<L, const N: usize> {
    /// `factors[pivot][column]`: the row of a pivot, divided by the pivot.
    pub(crate) factors: [[L; N]; N],
    pub(crate) inverse_pivots: [L; N],
}

/// The equation of motion at one state, with given accelerations of the joints.
pub(crate) struct InverseDynamics<L, const N: usize> {
    /// (M + A) q̈ + C q̇ + g.
    pub(crate) torque: [L; N],
    /// M + A.
    pub(crate) mass: FactoredMass<L, N>,
    pub(crate) last_link: Motion<L>,
}

/// The motion of a link, in the link's axes. Joints accelerate only where it says so.
#[derive(Clone, Copy)]
pub(crate) struct Motion<L> {
    pub(crate) angular_velocity: Vector<L>,
    pub(crate) angular_acceleration: Vector<L>,
    /// Acceleration of the frame's origin minus that of free fall.
    pub(crate) acceleration: Vector<L>,
    /// The columns x and y of [ω̇] + [ω]²: the acceleration of a point of the link per distance from
    /// the origin. First moments have no z, and neither do joint origins of the compiled structure.
    pub(crate) gradient: [[L; 2]; 3],
}

impl<L: Lanes> Motion<L> {
    #[inline(always)]
    pub(crate) fn new(w: Vector<L>, w_dot: Vector<L>, acceleration: Vector<L>) -> Self {
        let minus_zz = w[2].neg_mul_add(w[2], L::splat(0.0));
        let gradient = [
            [w[1].neg_mul_add(w[1], minus_zz), w[0].mul_add(w[1], -w_dot[2])],
            [w[0].mul_add(w[1], w_dot[2]), w[0].neg_mul_add(w[0], minus_zz)],
            [w[0].mul_add(w[2], -w_dot[1]), w[1].mul_add(w[2], w_dot[0])],
        ];
        Self { angular_velocity: w, angular_acceleration: w_dot, acceleration, gradient }
    }

    /// The motion of the second link. The first one turns about the vertical, which is its own z
    /// axis, and the second one sits on this axis.
    #[inline(always)]
    pub(crate) fn of_second_link(base_acceleration: L, turn: Turn<L>, qd: &[L; JOINTS]) -> Self {
        const { assert!(!shifted::<1>(0) && !shifted::<1>(1) && !shifted::<1>(2)) };
        let [x, y, _] = turn.axis_to_child::<1>(qd[0]);
        let w_dot = [y * qd[1], -(x * qd[1]), L::splat(0.0)];
        Self::new([x, y, qd[1]], w_dot, turn.axis_to_child::<1>(base_acceleration))
    }

    /// The motion of the link behind joint `J`, from that of the link before it.
    #[inline(always)]
    pub(crate) fn child<const J: usize>(&self, origin: &Vector<L>, turn: Turn<L>, qd: L) -> Self {
        let acceleration = add_matrix_origin::<L, J>(&self.gradient, origin, self.acceleration);
        let mut w = turn.to_child::<J>(self.angular_velocity);
        let mut w_dot = turn.to_child::<J>(self.angular_acceleration);
        w_dot[0] = w[1].mul_add(qd, w_dot[0]);
        w_dot[1] = w[0].neg_mul_add(qd, w_dot[1]);
        w[2] = w[2] + qd;
        Self::new(w, w_dot, turn.to_child::<J>(acceleration))
    }

    /// This motion with an acceleration of the link's own joint.
    #[inline(always)]
    pub(crate) fn accelerated(mut self, qdd: L) -> Self {
        self.angular_acceleration[2] = self.angular_acceleration[2] + qdd;
        self.gradient[0][1] = self.gradient[0][1] - qdd;
        self.gradient[1][0] = self.gradient[1][0] + qdd;
        self
    }

    /// The third column of [ω̇] + [ω]².
    #[inline(always)]
    pub(crate) fn gradient_along_z(&self) -> Vector<L> {
        let (w, w_dot) = (self.angular_velocity, self.angular_acceleration);
        let minus_xx = w[0].neg_mul_add(w[0], L::splat(0.0));
        [
            w[0].mul_add(w[2], w_dot[1]),
            w[1].mul_add(w[2], -w_dot[0]),
            w[1].neg_mul_add(w[1], minus_xx),
        ]
    }

    /// The acceleration of a point of the link, minus that of free fall.
    #[inline(always)]
    pub(crate) fn acceleration_at(&self, [x, y, z]: &Vector<L>) -> Vector<L> {
        let third = self.gradient_along_z();
        let mut acceleration = self.acceleration;
        for row in 0..3 {
            let [first, second] = self.gradient[row];
            let along = second.mul_add(*y, first.mul_add(*x, acceleration[row]));
            acceleration[row] = third[row].mul_add(*z, along);
        }
        acceleration
    }

    /// The wrench about the frame's origin that causes this motion of `link` (Newton and Euler).
    #[inline(always)]
    pub(crate) fn wrench(&self, link: &Link<L>) -> Wrench<L> {
        let [mx, my] = link.first_moment;
        let [xx, xy, xz, yz, zz] = link.inertia;
        let ([wx, wy, wz], [ax, ay, az]) = (self.angular_velocity, self.acceleration);
        let [turn_x, turn_y, turn_z] = self.angular_acceleration;

        let mut force = self.acceleration;
        for row in 0..3 {
            force[row] = self.gradient[row][1].mul_add(my, self.gradient[row][0] * mx);
        }
        let angular_momentum = [
            xz.mul_add(wz, xy.mul_add(wy, xx * wx)),
            yz.mul_add(wz, xy * wx),
            zz.mul_add(wz, yz.mul_add(wy, xz * wx)),
        ];
        // Inertia times angular acceleration, and first moment × acceleration.
        let euler = [
            xz.mul_add(turn_z, xy.mul_add(turn_y, xx.mul_add(turn_x, my * az))),
            yz.mul_add(turn_z, mx.neg_mul_add(az, xy * turn_x)),
            zz.mul_add(turn_z, yz.mul_add(turn_y, xz.mul_add(turn_x, my.neg_mul_add(ax, mx * ay)))),
        ];
        Wrench { force, moment: add_cross(self.angular_velocity, angular_momentum, euler) }
    }
}

/// The moment of [`Motion::wrench`] of a link at rest, with the acceleration of its frame against
/// free fall. Links have no mass, so there is no force.
#[inline(always)]
pub(crate) fn moment_at_rest<L: Lanes>(link: &Link<L>, [ax, ay, az]: Vector<L>) -> Vector<L> {
    let [mx, my] = link.first_moment;
    [my * az, -(mx * az), my.neg_mul_add(ax, mx * ay)]
}

/// A force and a moment about a frame's origin.
#[derive(Clone, Copy)]
pub(crate) struct Wrench<L> {
    pub(crate) force: Vector<L>,
    pub(crate) moment: Vector<L>,
}

impl<L: Lanes> Wrench<L> {
    #[inline(always)]
    pub(crate) fn zero() -> Self {
        Self { force: [L::splat(0.0); 3], moment: [L::splat(0.0); 3] }
    }

    #[inline(always)]
    pub(crate) fn plus(self, other: Self) -> Self {
        Self { force: sum(self.force, other.force), moment: sum(self.moment, other.moment) }
    }

    /// The same wrench about the origin of the link before joint `J`, in that link's axes.
    #[inline(always)]
    pub(crate) fn to_parent<const J: usize>(self, origin: &Vector<L>, turn: Turn<L>) -> Self {
        let force = turn.to_parent::<J>(self.force);
        let moment = turn.to_parent::<J>(self.moment);
        Self { force, moment: add_origin_cross::<L, J>(origin, force, moment) }
    }
}

/// A link and everything beyond it, as one rigid body.
#[derive(Clone, Copy)]
pub(crate) struct Composite<L> {
    pub(crate) first_moment: Vector<L>,
    pub(crate) inertia: Symmetric<L>,
}

impl<L: Lanes> Composite<L> {
    #[inline(always)]
    pub(crate) fn of_last_link(link: &Link<L>) -> Self {
        let zero = L::splat(0.0);
        let ([mx, my], [xx, xy, xz, yz, zz]) = (link.first_moment, link.inertia);
        Self { first_moment: [mx, my, zero], inertia: [xx, xy, xz, zero, yz, zz] }
    }

    /// This composite, carried by joint `J`, together with the link before the joint.
    #[inline(always)]
    pub(crate) fn with_parent<const J: usize>(
        self,
        origin: &Vector<L>,
        turn: Turn<L>,
        link: &Link<L>,
    ) -> Self {
        let first_moment = turn.to_parent::<J>(self.first_moment);
        let inertia = turn.symmetric_to_parent::<J>(self.inertia);
        let inertia = shifted_inertia::<L, J>(origin, first_moment, inertia);
        Self { first_moment, inertia }.with_link(link)
    }

    /// This composite together with a link, both in the link's frame.
    #[inline(always)]
    pub(crate) fn with_link(self, link: &Link<L>) -> Self {
        let Self { first_moment, inertia } = self;
        Self {
            first_moment: [
                first_moment[0] + link.first_moment[0],
                first_moment[1] + link.first_moment[1],
                first_moment[2],
            ],
            inertia: [
                inertia[0] + link.inertia[0],
                inertia[1] + link.inertia[1],
                inertia[2] + link.inertia[2],
                inertia[3],
                inertia[4] + link.inertia[3],
                inertia[5] + link.inertia[4],
            ],
        }
    }

    /// The wrench for a unit acceleration about the frame's z from rest.
    #[inline(always)]
    pub(crate) fn wrench_of_unit_acceleration(&self) -> Wrench<L> {
        let [x, y, _] = self.first_moment;
        let [_, _, xz, _, yz, zz] = self.inertia;
        Wrench { force: [-y, x, L::splat(0.0)], moment: [xz, yz, zz] }
    }
}

/// Solves (M + A + h D) q̈ = u − C q̇ − g − D q̇ − τ_f(q̇).
///
/// h is the length of the next step. Damping then acts at the step's end (implicitly). With h = 0
/// this is the acceleration at the given state. Friction always acts as at the step's start. It is
/// bounded, and where a step crosses its bend, its tangent has a larger error than its value.
#[inline(always)]
pub(crate) fn accelerations<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    model: &Model<L, N>,
    dynamics: &Dynamics<L, N>,
    qd: &[L; N],
    torque: &[L; N],
    step: L,
    qdd: &mut [L; N],
) {
    let mut b = *torque;
    for joint in 0..structure.joints() {
        b[joint] =
            model.damping[joint].neg_mul_add(qd[joint], torque[joint] - dynamics.bias[joint]);
    }
    // All robots of a simulation have friction, or none has it. So the branch is always the same.
    if let Some(friction) = &model.friction {
        for joint in 0..structure.joints() {
            b[joint] = b[joint] - friction.torque(joint, qd[joint]);
        }
    }
    // This is read after the branch, because the compiler would keep a copy across it.
    let mut m = dynamics.mass_matrix;
    for joint in 0..structure.joints() {
        m[joint][joint] = step.mul_add(model.damping[joint], m[joint][joint]);
    }
    structure.solve(&mut m, &mut b, qdd);
}
