//! How the links of an arm hang together, as far as kernels are compiled for it.

use simd::Lanes;

use crate::Robot;
use crate::compiled;
use crate::forward_dynamics::{Dynamics, accelerations};
use crate::model::Model;
use crate::spatial::Turn;

/// The difference between kernels for arms of one structure and those for all: `N` is the length of their
/// arrays. Every method is `#[inline(always)]`, as those of [`Lanes`].
pub(crate) trait Structure<const N: usize>: Copy + Send + Sync {
    /// Joints that there are; at most `N`.
    fn joints(self) -> usize;

    /// Sine and cosine of every joint's angle `q` (rad) that matters.
    fn turns<L: Lanes>(self, q: &[L; N], turns: &mut [Turn<L>; N]);

    /// As [`Structure::turns`], of angles that lie little beyond others whose turns are known.
    fn later_turns<L: Lanes>(self, start: &[Turn<L>; N], change: &[L; N], turns: &mut [Turn<L>; N]);

    /// M + A and C q̇ + g at the positions of `turns` and velocities `qd` (rad/s).
    fn mass_matrix_and_bias<L: Lanes>(
        self,
        model: &Model<L, N>,
        turns: &[Turn<L>; N],
        qd: &[L; N],
        dynamics: &mut Dynamics<L, N>,
    );

    /// As [`Structure::mass_matrix_and_bias`] and then [`accelerations`], to the last bit.
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

/// The kernels for some robots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Compiled,
    General { joints: usize },
}

impl Kind {
    /// The fastest kernels that all of the robots can have, which have as many joints as the first.
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

/// Evaluates `$body` with `$structure` bound to the structure of a [`Kind`].
macro_rules! with_structure {
    ($kind:expr, |$structure:ident| $body:expr) => {
        match $kind {
            $crate::structure::Kind::Compiled => {
                let $structure = $crate::compiled::Compiled;
                $body
            }
            $crate::structure::Kind::General { joints } => {
                let $structure = $crate::general::General::new(joints);
                $body
            }
        }
    };
}

pub(crate) use with_structure;
