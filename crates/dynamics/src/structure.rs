//! The structure of an arm, for which kernels are compiled.

use simd::Lanes;

use crate::forward_dynamics::{Dynamics, accelerations};
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
