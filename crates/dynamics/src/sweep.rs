//! The compiled structure's equation of motion, from the tip inwards.
//!
//! Motions are computed outwards and the mass matrix inwards, and neither needs the other.
//! [`sweep`] alternates between them, so that one computes while the other waits for its last
//! result. The order of the lines decides what may run at the same time, because a processor looks
//! only a few hundred instructions ahead.

use simd::Lanes;

use crate::compiled::{Compiled, JOINTS, TWISTS, Twist, shifted};
use crate::forward_dynamics::{
    Composite, Dynamics, FactoredMass, InverseDynamics, Motion, Wrench, moment_at_rest,
};
use crate::hand::{Place, Tilt, Walker};
use crate::model::Model;
use crate::spatial::{Turn, sum};
use crate::structure::Structure;

/// A receiver of the equation of motion. The sweep gives it columns and bias forces joint by joint,
/// from the last to the first.
trait Equation<L> {
    /// The accelerations of the joints, if they have any.
    #[inline(always)]
    fn joint_accelerations(&self) -> Option<&[L; JOINTS]> {
        None
    }

    /// The motion of the last link.
    #[inline(always)]
    fn last_link(&mut self, _motion: &Motion<L>) {}

    /// `entries[J..]` are entries (J.., J) of M + A.
    fn column<const J: usize>(&mut self, entries: &[L; JOINTS]);

    /// Entry `J` of C q̇ + g, after column `J`.
    fn bias<const J: usize>(&mut self, bias: L);
}

impl<L: Lanes> Equation<L> for Dynamics<L, JOINTS> {
    #[inline(always)]
    fn column<const J: usize>(&mut self, entries: &[L; JOINTS]) {
        for row in J..JOINTS {
            self.mass_matrix[row][J] = entries[row];
        }
    }

    #[inline(always)]
    fn bias<const J: usize>(&mut self, bias: L) {
        self.bias[J] = bias;
    }
}

/// Eliminates joint after joint as the columns arrive. [`Structure::solve`] has the same operations
/// on the same numbers, one pivot after another.
struct Elimination<'a, L> {
    model: &'a Model<L, JOINTS>,
    /// The length of the step in seconds, as for [`crate::forward_dynamics::accelerations`].
    step: L,
    qd: &'a [L; JOINTS],
    torque: &'a [L; JOINTS],
    friction: [L; JOINTS],
    /// Those of M + A + h D.
    reduction: Reduction<L>,
    /// The right side, reduced like the matrix.
    right: [L; JOINTS],
}

/// A mass matrix, of which one joint after another is eliminated.
struct Reduction<L> {
    /// The matrix, with the share of eliminated joints subtracted.
    matrix: [[L; JOINTS]; JOINTS],
    factored: FactoredMass<L, JOINTS>,
}

/// Evaluates `$body` for each pivot beyond joint `$joint`, from the last.
macro_rules! for_each_pivot {
    ($pivot:ident beyond $joint:ident, $body:block) => {
        for_each_pivot!(@ $pivot, $joint, $body, 6 5 4 3 2 1)
    };
    (@ $pivot:ident, $joint:ident, $body:block, $($number:literal)*) => {$(
        if $number > $joint {
            const $pivot: usize = $number;
            $body
        }
    )*};
}

impl<L: Lanes> Reduction<L> {
    #[inline(always)]
    fn new() -> Self {
        let zero = [L::splat(0.0); JOINTS];
        let factored = FactoredMass { factors: [zero; JOINTS], inverse_pivots: zero };
        Self { matrix: [zero; JOINTS], factored }
    }

    /// `entries[J..]` are entries (J.., J) of the matrix.
    #[inline(always)]
    fn column<const J: usize>(&mut self, entries: &[L; JOINTS]) {
        let Self { matrix, factored: FactoredMass { factors, inverse_pivots } } = self;
        for row in J..JOINTS {
            matrix[row][J] = entries[row];
        }
        for_each_pivot!(PIVOT beyond J, {
            for row in J + 1..PIVOT {
                let change = factors[PIVOT][row];
                matrix[row][J] = change.neg_mul_add(matrix[PIVOT][J], matrix[row][J]);
            }
            let factor = matrix[PIVOT][J] * inverse_pivots[PIVOT];
            matrix[J][J] = factor.neg_mul_add(matrix[PIVOT][J], matrix[J][J]);
            factors[PIVOT][J] = factor;
        });
        inverse_pivots[J] = matrix[J][J].recip();
    }
}

/// The torques for given accelerations, and the factors of the mass matrix.
struct Inversion<'a, L> {
    model: &'a Model<L, JOINTS>,
    qdd: &'a [L; JOINTS],
    reduction: Reduction<L>,
    torque: [L; JOINTS],
    last_link: Motion<L>,
}

impl<L: Lanes> Equation<L> for Inversion<'_, L> {
    #[inline(always)]
    fn joint_accelerations(&self) -> Option<&[L; JOINTS]> {
        Some(self.qdd)
    }

    #[inline(always)]
    fn last_link(&mut self, motion: &Motion<L>) {
        self.last_link = *motion;
    }

    #[inline(always)]
    fn column<const J: usize>(&mut self, entries: &[L; JOINTS]) {
        self.reduction.column::<J>(entries);
    }

    #[inline(always)]
    fn bias<const J: usize>(&mut self, bias: L) {
        let mut inertia = self.model.armature[J];
        if J == 0 {
            // The first link's own inertia; its motion is not part of the sweep.
            inertia = inertia + self.model.links[0].inertia[4];
        }
        self.torque[J] = inertia.mul_add(self.qdd[J], bias);
    }
}

impl<'a, L: Lanes> Elimination<'a, L> {
    #[inline(always)]
    fn new(
        model: &'a Model<L, JOINTS>,
        qd: &'a [L; JOINTS],
        torque: &'a [L; JOINTS],
        step: L,
    ) -> Self {
        let zero = [L::splat(0.0); JOINTS];
        let mut friction = zero;
        // All robots of a simulation have friction, or none has it. So the branch is always the
        // same.
        if let Some(sigmoids) = &model.friction {
            for joint in 0..JOINTS {
                friction[joint] = sigmoids.torque(joint, qd[joint]);
            }
        }
        Self { model, step, qd, torque, friction, reduction: Reduction::new(), right: zero }
    }

    /// The accelerations, after every column and every bias force.
    #[inline(always)]
    fn substitute(&self, qdd: &mut [L; JOINTS]) {
        for joint in 0..JOINTS {
            let mut rest = self.right[joint];
            for inner in 0..joint {
                rest = self.reduction.matrix[joint][inner].neg_mul_add(qdd[inner], rest);
            }
            qdd[joint] = rest * self.reduction.factored.inverse_pivots[joint];
        }
    }
}

impl<L: Lanes> Equation<L> for Elimination<'_, L> {
    #[inline(always)]
    fn column<const J: usize>(&mut self, entries: &[L; JOINTS]) {
        let mut damped = *entries;
        damped[J] = self.step.mul_add(self.model.damping[J], entries[J]);
        self.reduction.column::<J>(&damped);
    }

    #[inline(always)]
    fn bias<const J: usize>(&mut self, bias: L) {
        let Self { model, qd, torque, friction, reduction, right, .. } = self;
        let factors = &reduction.factored.factors;
        right[J] = model.damping[J].neg_mul_add(qd[J], torque[J] - bias) - friction[J];
        for_each_pivot!(PIVOT beyond J, {
            right[J] = factors[PIVOT][J].neg_mul_add(right[PIVOT], right[J]);
        });
    }
}

#[inline(always)]
fn sweep<L: Lanes>(
    model: &Model<L, JOINTS>,
    turns: &[Turn<L>; JOINTS],
    qd: &[L; JOINTS],
    equation: &mut impl Equation<L>,
) {
    let (links, origins) = (&model.links, &model.origins);
    let zero = [L::splat(0.0); JOINTS];
    // Column `j` is the wrench for a unit acceleration of joint `j` alone.
    let mut columns = [Wrench::zero(); JOINTS];

    // Computes the motion of the link behind joint `$joint`, and the wrench for it.
    macro_rules! outwards {
        ($motion:ident over $joint:literal) => {{
            let origin = &origins[$joint];
            $motion = $motion.child::<$joint>(origin, turns[$joint], qd[$joint]);
            if let Some(qdd) = equation.joint_accelerations() {
                $motion = $motion.accelerated(qdd[$joint]);
            }
            $motion.wrench(&links[$joint])
        }};
    }
    // Adds the diagonal entry and the column of a composite at its joint.
    macro_rules! joint {
        ($joint:literal, $composite:ident, $entries:ident) => {
            columns[$joint] = $composite.wrench_of_unit_acceleration();
            $entries[$joint] = columns[$joint].moment[2] + model.armature[$joint];
            equation.column::<$joint>(&$entries);
        };
    }
    // Moves a composite and the columns so far across joint `$joint` to the link before it.
    macro_rules! inwards {
        ($composite:ident over $joint:literal to $parent:literal) => {
            let (origin, turn) = (&origins[$joint], turns[$joint]);
            $composite = $composite.with_parent::<$joint>(origin, turn, &links[$parent]);
            let mut entries = zero;
            for column in $joint..JOINTS {
                columns[column] = columns[column].to_parent::<$joint>(origin, turn);
                entries[column] = columns[column].moment[2];
            }
            joint!($parent, $composite, entries);
        };
    }
    // Moves the wrench at joint `$joint` to the link before it, and adds that link's own wrench.
    macro_rules! carry {
        ($wrench:ident over $joint:literal to $parent:literal, $own:expr) => {
            $wrench = $wrench.to_parent::<$joint>(&origins[$joint], turns[$joint]).plus($own);
            equation.bias::<$parent>($wrench.moment[2]);
        };
    }

    let mut motion = Motion::of_second_link(model.base_acceleration[2], turns[1], qd);
    if let Some(qdd) = equation.joint_accelerations() {
        let carried = turns[1].axis_to_child::<1>(qdd[0]);
        let turning = sum(motion.angular_acceleration, carried);
        motion = Motion::new(motion.angular_velocity, turning, motion.acceleration);
        motion = motion.accelerated(qdd[1]);
    }
    let wrench1 = motion.wrench(&links[1]);
    let mut composite = Composite::of_last_link(&links[6]);
    let mut entries = zero;
    joint!(6, composite, entries);
    inwards!(composite over 6 to 5);
    let wrench2 = outwards!(motion over 2);
    inwards!(composite over 5 to 4);
    let wrench3 = outwards!(motion over 3);
    inwards!(composite over 4 to 3);
    let wrench4 = outwards!(motion over 4);
    inwards!(composite over 3 to 2);
    let wrench5 = outwards!(motion over 5);
    inwards!(composite over 2 to 1);
    let mut wrench = outwards!(motion over 6);
    equation.last_link(&motion);
    // Only the first link's inertia about the vertical matters; its own wrench has no moment there.
    inwards!(composite over 1 to 0);

    equation.bias::<6>(wrench.moment[2]);
    carry!(wrench over 6 to 5, wrench5);
    carry!(wrench over 5 to 4, wrench4);
    carry!(wrench over 4 to 3, wrench3);
    carry!(wrench over 3 to 2, wrench2);
    carry!(wrench over 2 to 1, wrench1);
    carry!(wrench over 1 to 0, Wrench::zero());
}

impl Structure<JOINTS> for Compiled {
    #[inline(always)]
    fn joints(self) -> usize {
        JOINTS
    }

    /// The turns of all joints but the first, whose turn has no effect: gravity is along its axis.
    #[inline(always)]
    fn turns<L: Lanes>(self, _: &Model<L, JOINTS>, q: &[L; JOINTS], turns: &mut [Turn<L>; JOINTS]) {
        for joint in 1..JOINTS {
            turns[joint] = Turn::by(q[joint]);
        }
    }

    #[inline(always)]
    fn all_turns<L: Lanes>(
        self,
        model: &Model<L, JOINTS>,
        q: &[L; JOINTS],
        turns: &mut [Turn<L>; JOINTS],
    ) {
        self.turns(model, q, turns);
        turns[0] = Turn::by(q[0]);
    }

    #[inline(always)]
    fn later_turns<L: Lanes>(
        self,
        start: &[Turn<L>; JOINTS],
        change: &[L; JOINTS],
        turns: &mut [Turn<L>; JOINTS],
    ) {
        for joint in 1..JOINTS {
            turns[joint] = start[joint].followed_by(change[joint]);
        }
    }

    #[inline(always)]
    fn mass_matrix_and_bias<L: Lanes>(
        self,
        model: &Model<L, JOINTS>,
        turns: &[Turn<L>; JOINTS],
        qd: &[L; JOINTS],
        dynamics: &mut Dynamics<L, JOINTS>,
    ) {
        sweep(model, turns, qd, dynamics);
    }

    #[inline(always)]
    fn inverse_dynamics<L: Lanes>(
        self,
        model: &Model<L, JOINTS>,
        turns: &[Turn<L>; JOINTS],
        qd: &[L; JOINTS],
        qdd: &[L; JOINTS],
    ) -> InverseDynamics<L, JOINTS> {
        let (reduction, torque) = (Reduction::new(), [L::splat(0.0); JOINTS]);
        let still = [L::splat(0.0); 3];
        let last_link = Motion::new(still, still, still);
        let mut inversion = Inversion { model, qdd, reduction, torque, last_link };
        sweep(model, turns, qd, &mut inversion);
        let Inversion { reduction, torque, last_link, .. } = inversion;
        InverseDynamics { torque, mass: reduction.factored, last_link }
    }

    #[inline(always)]
    fn gravity<L: Lanes>(
        self,
        model: &Model<L, JOINTS>,
        turns: &[Turn<L>; JOINTS],
        gravity: &mut [L; JOINTS],
    ) {
        let up = turns[1].axis_to_child::<1>(model.base_acceleration[2]);
        let mut moments = [moment_at_rest(&model.links[1], up); JOINTS];
        let mut acceleration = up;
        macro_rules! outwards {
            ($($joint:literal)*) => {$(
                acceleration = turns[$joint].to_child::<$joint>(acceleration);
                moments[$joint] = moment_at_rest(&model.links[$joint], acceleration);
            )*};
        }
        outwards!(2 3 4 5 6);
        let mut moment = moments[6];
        macro_rules! inwards {
            ($($joint:literal to $parent:literal)*) => {$(
                gravity[$joint] = moment[2];
                moment = sum(turns[$joint].to_parent::<$joint>(moment), moments[$parent]);
            )*};
        }
        inwards!(6 to 5 5 to 4 4 to 3 3 to 2 2 to 1);
        gravity[1] = moment[2];
        gravity[0] = turns[1].to_parent::<1>(moment)[2];
    }

    #[inline(always)]
    fn walk<L: Lanes>(self, model: &Model<L, JOINTS>, walker: &mut impl Walker<L>) {
        macro_rules! pass {
            ($($joint:literal)*) => {$(
                let along = const {
                    [shifted::<$joint>(0), shifted::<$joint>(1), shifted::<$joint>(2)]
                };
                let tilt = match const { TWISTS[$joint] } {
                    Twist::None => Tilt::None,
                    Twist::Quarter => Tilt::Quarter,
                    Twist::MinusQuarter => Tilt::MinusQuarter,
                };
                walker.pass($joint, &Place { origin: model.origins[$joint], shifted: along, tilt });
            )*};
        }
        pass!(0 1 2 3 4 5 6);
    }

    #[inline(always)]
    fn accelerations_at<L: Lanes>(
        self,
        model: &Model<L, JOINTS>,
        turns: &[Turn<L>; JOINTS],
        qd: &[L; JOINTS],
        torque: &[L; JOINTS],
        step: L,
        qdd: &mut [L; JOINTS],
    ) {
        let mut elimination = Elimination::new(model, qd, torque, step);
        sweep(model, turns, qd, &mut elimination);
        elimination.substitute(qdd);
    }

    #[inline(always)]
    fn solve<L: Lanes>(
        self,
        m: &mut [[L; JOINTS]; JOINTS],
        b: &mut [L; JOINTS],
        qdd: &mut [L; JOINTS],
    ) {
        let mut inverse_pivots = [L::splat(0.0); JOINTS];
        // Joint 7 is eliminated first, because its column is ready first.
        macro_rules! eliminate {
            ($($pivot:literal)*) => {$(
                inverse_pivots[$pivot] = m[$pivot][$pivot].recip();
                for row in 0..$pivot {
                    let factor = m[$pivot][row] * inverse_pivots[$pivot];
                    for column in 0..=row {
                        m[row][column] = factor.neg_mul_add(m[$pivot][column], m[row][column]);
                    }
                    b[row] = factor.neg_mul_add(b[$pivot], b[row]);
                }
            )*};
        }
        macro_rules! substitute {
            ($($joint:literal)*) => {$(
                let mut rest = b[$joint];
                for inner in 0..$joint {
                    rest = m[$joint][inner].neg_mul_add(qdd[inner], rest);
                }
                qdd[$joint] = rest * inverse_pivots[$joint];
            )*};
        }
        eliminate!(6 5 4 3 2 1);
        inverse_pivots[0] = m[0][0].recip();
        qdd[0] = b[0] * inverse_pivots[0];
        substitute!(1 2 3 4 5 6);
    }
}
