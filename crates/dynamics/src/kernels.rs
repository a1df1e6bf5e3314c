//! The functions of one evaluation that are compiled once per lane type and structure, for the
//! instructions of that type.
//!
//! All other code over lanes is inlined into these. They are few and never inlined into each other.
//! One evaluation of the dynamics is about a thousand instructions, and would otherwise be copied
//! into every stage of every integrator.

use simd::{Kernel, Lanes, align_stack};

use crate::forward_dynamics::{self, Dynamics};
use crate::integrators::{self, Scheme, Scratch, State};
use crate::model::Model;
use crate::spatial::Turn;
use crate::structure::Structure;

/// See [`Structure::mass_matrix_and_bias`].
pub(crate) struct MassMatrixAndBias<'a, S, L, const N: usize> {
    pub(crate) structure: S,
    pub(crate) model: &'a Model<L, N>,
    pub(crate) turns: &'a [Turn<L>; N],
    pub(crate) qd: &'a [L; N],
    pub(crate) dynamics: &'a mut Dynamics<L, N>,
}

impl<L: Lanes, S: Structure<N>, const N: usize> Kernel<L> for MassMatrixAndBias<'_, S, L, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        align_stack();
        let Self { structure, model, turns, qd, dynamics } = self;
        structure.mass_matrix_and_bias(model, turns, qd, dynamics);
    }
}

/// See [`Structure::gravity`], at positions `q`.
pub(crate) struct Gravity<'a, S, L, const N: usize> {
    pub(crate) structure: S,
    pub(crate) model: &'a Model<L, N>,
    pub(crate) q: &'a [L; N],
    pub(crate) gravity: &'a mut [L; N],
}

impl<L: Lanes, S: Structure<N>, const N: usize> Kernel<L> for Gravity<'_, S, L, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        align_stack();
        let Self { structure, model, q, gravity } = self;
        let mut turns = [Turn::none(); N];
        structure.turns(model, q, &mut turns);
        structure.gravity(model, &turns, gravity);
    }
}

/// See [`Structure::accelerations_at`].
pub(crate) struct AccelerationsAt<'a, S, L, const N: usize> {
    pub(crate) structure: S,
    pub(crate) model: &'a Model<L, N>,
    pub(crate) turns: &'a [Turn<L>; N],
    pub(crate) qd: &'a [L; N],
    pub(crate) torque: &'a [L; N],
    pub(crate) step: L,
    pub(crate) qdd: &'a mut [L; N],
}

impl<L: Lanes, S: Structure<N>, const N: usize> Kernel<L> for AccelerationsAt<'_, S, L, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        align_stack();
        let Self { structure, model, turns, qd, torque, step, qdd } = self;
        structure.accelerations_at(model, turns, qd, torque, step, qdd);
    }
}

/// See [`forward_dynamics::accelerations`].
pub(crate) struct Accelerations<'a, S, L, const N: usize> {
    pub(crate) structure: S,
    pub(crate) model: &'a Model<L, N>,
    pub(crate) dynamics: &'a Dynamics<L, N>,
    pub(crate) qd: &'a [L; N],
    pub(crate) torque: &'a [L; N],
    pub(crate) step: L,
    pub(crate) qdd: &'a mut [L; N],
}

impl<L: Lanes, S: Structure<N>, const N: usize> Kernel<L> for Accelerations<'_, S, L, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        align_stack();
        let Self { structure, model, dynamics, qd, torque, step, qdd } = self;
        forward_dynamics::accelerations(structure, model, dynamics, qd, torque, step, qdd);
    }
}

/// See [`integrators::advance`]. Replays and simulations, open and closed loop, share it.
pub(crate) struct Advance<'a, S, L, const N: usize> {
    pub(crate) structure: S,
    pub(crate) scheme: Scheme,
    /// s.
    pub(crate) period: f64,
    pub(crate) model: &'a Model<L, N>,
    /// N·m.
    pub(crate) torque: &'a [L; N],
    pub(crate) state: &'a mut State<L, N>,
    pub(crate) scratch: &'a mut Scratch<L, N>,
}

impl<L: Lanes, S: Structure<N>, const N: usize> Kernel<L> for Advance<'_, S, L, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        align_stack();
        let Self { structure, scheme, period, model, torque, state, scratch } = self;
        integrators::advance(structure, scheme, period, model, torque, state, scratch);
    }
}
