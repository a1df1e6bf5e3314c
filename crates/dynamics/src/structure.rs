//! The structure of an arm, for which kernels are compiled.

use simd::Lanes;

use crate::forward_dynamics::{Dynamics, InverseDynamics, accelerations};
use crate::hand::Walker;
use crate::model::Model;
use crate::spatial::Turn;
use crate::{Robot, compiled};

/// The kernels for arms of one structure, or for all arms. `N` is the length of their arrays. Every
/// method is `#[inline(always)]`, like those of [`Lanes`].
pub(crate) trait Structure<const N: usize>: Copy + Send + Sync {
    /// Number of joints, at most `N`.
    fn joints(self) -> usize;

    /// Sine and cosine of the angle of every joint whose turn matters, at positions `q` (rad).
    fn turns<L: Lanes>(self, model: &Model<L, N>, q: &[L; N], turns: &mut [Turn<L>; N]);

    /// [`Structure::turns`], and those of joints whose turn does not matter for the dynamics.
    fn all_turns<L: Lanes>(self, model: &Model<L, N>, q: &[L; N], turns: &mut [Turn<L>; N]);

    /// [`Structure::turns`] of angles that differ by a small `change` from others with known turns.
    fn later_turns<L: Lanes>(self, start: &[Turn<L>; N], change: &[L; N], turns: &mut [Turn<L>; N]);

    /// M + A and C q̇ + g at the positions of `turns` and velocities `qd` (rad/s).
    fn mass_matrix_and_bias<L: Lanes>(
        self,
        model: &Model<L, N>,
        turns: &[Turn<L>; N],
        qd: &[L; N],
        dynamics: &mut Dynamics<L, N>,
    );

    /// g at the positions of `turns`: [`Structure::mass_matrix_and_bias`] at rest, bit for bit.
    fn gravity<L: Lanes>(self, model: &Model<L, N>, turns: &[Turn<L>; N], gravity: &mut [L; N]);

    /// The torques for accelerations `qdd` (rad/s²), and the factors of M + A.
    fn inverse_dynamics<L: Lanes>(
        self,
        model: &Model<L, N>,
        turns: &[Turn<L>; N],
        qd: &[L; N],
        qdd: &[L; N],
    ) -> InverseDynamics<L, N>;

    /// Leads `walker` past the places of all joints.
    fn walk<L: Lanes>(self, model: &Model<L, N>, walker: &mut impl Walker<L>);

    /// [`Structure::mass_matrix_and_bias`] followed by [`accelerations`], bit for bit.
    #[inline(always)]
    fn accelerations_at<L: Lanes>(
        self,
        model: &Model<L, N>,
        turns: &[Turn<L>; N],
        qd: &[L; N],
        torque: &[L; N],
        step: L,
        qdd: &mut [L; N],
    ) {
        let mut dynamics = Dynamics::zero();
        self.mass_matrix_and_bias(model, turns, qd, &mut dynamics);
        accelerations(self, model, &dynamics, qd, torque, step, qdd);
    }

    /// Solves `m · qdd = b` for a symmetric positive definite `m`, given on and below the diagonal, in place.
    fn solve<L: Lanes>(self, m: &mut [[L; N]; N], b: &mut [L; N], qdd: &mut [L; N]);
}

/// The kernels that fit a set of robots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Compiled,
    General { joints: usize },
}

impl Kind {
    /// The fastest kernels that fit all robots. All have as many joints as the first.
    pub(crate) fn of<'a>(robots: impl IntoIterator<Item = &'a Robot>) -> Self {
        let mut joints = 0;
        let mut fits = true;
        for robot in robots {
            joints = robot.links.len();
            fits &= compiled::fits(&robot.kinematics);
        }
        if fits { Self::Compiled } else { Self::General { joints } }
    }
}

impl Robot {
    /// Whether there are kernels compiled for this robot's structure. Those for all robots are slower.
    pub fn has_compiled_kernels(&self) -> bool {
        Kind::of([self]) == Kind::Compiled
    }
}

/// Evaluates `$body` with `$structure` bound to the structure of a [`Kind`].
macro_rules! with_structure {
    ($kind:expr, |$structure:ident| $body:expr) => {
        match $kind {
            $crate::structure::Kind::Compiled => {
                let $structure = $crate::compiled::Compiled;
                $body
            }
            $crate::structure::Kind::General { joints: joints @ 6 } => {
                let $structure = $crate::general::General::<6>::new(joints);
                $body
            }
            $crate::structure::Kind::General { joints: joints @ 7 } => {
                let $structure = $crate::general::General::<7>::new(joints);
                $body
            }
            $crate::structure::Kind::General { joints } => {
                let $structure = $crate::general::General::<{ spec::MAX_JOINTS }>::new(joints);
                $body
            }
        }
    };
}

pub(crate) use with_structure;

#[cfg(test)]
mod tests {
    use simd::F64Array;

    use super::*;
    use crate::compiled::Compiled;
    use crate::forward_dynamics::FactoredMass;
    use crate::general::General;

    type Lane = F64Array<1>;

    fn lanes(values: [f64; 7]) -> [Lane; 7] {
        values.map(Lane::splat)
    }

    fn moving() -> [[Lane; 7]; 3] {
        [
            lanes([0.3, -0.7, 0.4, -1.9, 0.8, 1.7, -0.5]),
            lanes([0.9, -0.4, 1.1, 0.2, -0.8, 0.6, 1.5]),
            lanes([-2.0, 1.0, 0.5, -3.0, 2.5, 1.5, -0.7]),
        ]
    }

    fn gravity_is_the_bias_at_rest<S: Structure<7>>(structure: S) {
        let model = Model::<Lane, 7>::splat(structure, &Robot::panda());
        let mut turns = [Turn::none(); 7];
        structure.turns(&model, &moving()[0], &mut turns);
        let mut dynamics = Dynamics::zero();
        structure.mass_matrix_and_bias(&model, &turns, &lanes([0.0; 7]), &mut dynamics);
        let mut gravity = lanes([f64::NAN; 7]);
        structure.gravity(&model, &turns, &mut gravity);
        for joint in 0..7 {
            // The sign of a zero does not matter.
            let [found, expected] =
                [&gravity, &dynamics.bias].map(|torques| torques[joint].lane(0) + 0.0);
            assert_eq!(found.to_bits(), expected.to_bits(), "joint {joint}");
        }
    }

    #[test]
    fn gravity_is_that_of_the_equation_of_motion_bit_for_bit() {
        gravity_is_the_bias_at_rest(Compiled);
        gravity_is_the_bias_at_rest(General::<7>::new(7));
    }

    fn inverse_dynamics_is_the_equation_of_motion<S: Structure<7>>(structure: S) {
        let model = Model::<Lane, 7>::splat(structure, &Robot::panda());
        let [q, qd, qdd] = moving();
        let mut turns = [Turn::none(); 7];
        structure.all_turns(&model, &q, &mut turns);
        let mut dynamics = Dynamics::zero();
        structure.mass_matrix_and_bias(&model, &turns, &qd, &mut dynamics);
        let inverse = structure.inverse_dynamics(&model, &turns, &qd, &qdd);
        let FactoredMass { factors, inverse_pivots } = inverse.mass;
        for row in 0..7 {
            let mut torque = dynamics.bias[row].lane(0);
            for column in 0..7 {
                let entry = dynamics.mass_matrix[row.max(column)][row.min(column)].lane(0);
                torque += entry * qdd[column].lane(0);
                // M = Σ f fᵀ d over the pivots d with their rows f.
                let mut product = 0.0;
                for pivot in row.max(column)..7 {
                    let factor = |joint: usize| {
                        if joint == pivot { 1.0 } else { factors[pivot][joint].lane(0) }
                    };
                    product += factor(row) * factor(column) / inverse_pivots[pivot].lane(0);
                }
                assert!((product - entry).abs() < 1e-13, "entry {row} {column}");
            }
            assert!((inverse.torque[row].lane(0) - torque).abs() < 1e-12, "joint {row}");
        }
    }

    #[test]
    fn inverse_dynamics_are_those_of_the_equation_of_motion() {
        inverse_dynamics_is_the_equation_of_motion(Compiled);
        inverse_dynamics_is_the_equation_of_motion(General::<7>::new(7));
    }
}
