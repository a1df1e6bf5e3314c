//! The functions of one evaluation that are compiled once per lane type and structure, for the instructions
//! of that type.
//!
//! All other code over lanes is inlined into these. They are few and never inlined into each other.
//! One evaluation of the dynamics is about a thousand instructions, and would otherwise be copied
//! into every stage of every integrator.

use simd::{F32Array, F64Array, Lanes, align_stack};

use crate::forward_dynamics::{self, Dynamics};
use crate::model::Model;
use crate::spatial::Turn;
use crate::structure::Structure;

pub(crate) trait Kernels: Lanes {
    /// See [`Structure::mass_matrix_and_bias`].
    fn mass_matrix_and_bias<S: Structure<N>, const N: usize>(
        structure: S,
        model: &Model<Self, N>,
        turns: &[Turn<Self>; N],
        qd: &[Self; N],
        dynamics: &mut Dynamics<Self, N>,
    );

    /// See [`Structure::accelerations_at`].
    fn accelerations_at<S: Structure<N>, const N: usize>(
        structure: S,
        model: &Model<Self, N>,
        turns: &[Turn<Self>; N],
        qd: &[Self; N],
        torque: &[Self; N],
        step: Self,
        qdd: &mut [Self; N],
    );

    /// See [`forward_dynamics::accelerations`].
    fn accelerations<S: Structure<N>, const N: usize>(
        structure: S,
        model: &Model<Self, N>,
        dynamics: &Dynamics<Self, N>,
        qd: &[Self; N],
        torque: &[Self; N],
        step: Self,
        qdd: &mut [Self; N],
    );
}

macro_rules! kernels {
    ($lanes:ty $(, $features:literal)?) => {
        impl Kernels for $lanes {
            #[inline(always)]
            fn mass_matrix_and_bias<S: Structure<N>, const N: usize>(
                structure: S,
                model: &Model<Self, N>,
                turns: &[Turn<Self>; N],
                qd: &[Self; N],
                dynamics: &mut Dynamics<Self, N>,
            ) {
                $(#[target_feature(enable = $features)])?
                #[inline(never)]
                fn compiled<S: Structure<N>, const N: usize>(
                    structure: S,
                    model: &Model<$lanes, N>,
                    turns: &[Turn<$lanes>; N],
                    qd: &[$lanes; N],
                    dynamics: &mut Dynamics<$lanes, N>,
                ) {
                    align_stack();
                    structure.mass_matrix_and_bias(model, turns, qd, dynamics);
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(structure, model, turns, qd, dynamics)
                }
            }

            #[inline(always)]
            fn accelerations_at<S: Structure<N>, const N: usize>(
                structure: S,
                model: &Model<Self, N>,
                turns: &[Turn<Self>; N],
                qd: &[Self; N],
                torque: &[Self; N],
                step: Self,
                qdd: &mut [Self; N],
            ) {
                $(#[target_feature(enable = $features)])?
                #[inline(never)]
                fn compiled<S: Structure<N>, const N: usize>(
                    structure: S,
                    model: &Model<$lanes, N>,
                    turns: &[Turn<$lanes>; N],
                    qd: &[$lanes; N],
                    torque: &[$lanes; N],
                    step: $lanes,
                    qdd: &mut [$lanes; N],
                ) {
                    align_stack();
                    structure.accelerations_at(model, turns, qd, torque, step, qdd);
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(structure, model, turns, qd, torque, step, qdd)
                }
            }

            #[inline(always)]
            fn accelerations<S: Structure<N>, const N: usize>(
                structure: S,
                model: &Model<Self, N>,
                dynamics: &Dynamics<Self, N>,
                qd: &[Self; N],
                torque: &[Self; N],
                step: Self,
                qdd: &mut [Self; N],
            ) {
                $(#[target_feature(enable = $features)])?
                #[inline(never)]
                fn compiled<S: Structure<N>, const N: usize>(
                    structure: S,
                    model: &Model<$lanes, N>,
                    dynamics: &Dynamics<$lanes, N>,
                    qd: &[$lanes; N],
                    torque: &[$lanes; N],
                    step: $lanes,
                    qdd: &mut [$lanes; N],
                ) {
                    align_stack();
                    forward_dynamics::accelerations(structure, model, dynamics, qd, torque, step, qdd);
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(structure, model, dynamics, qd, torque, step, qdd)
                }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::*;
    use simd::{F32x8, F32x16, F64x4, F64x8};

    kernels!(F32x16, "avx512f,avx512dq,avx512vl,avx2,fma");
    kernels!(F64x8, "avx512f,avx512dq,avx512vl,avx2,fma");
    kernels!(F32x8, "avx2,fma");
    kernels!(F64x4, "avx2,fma");
}

kernels!(F32Array<8>);
kernels!(F64Array<4>);
kernels!(F64Array<1>);
kernels!(crate::operations::Recorded);
