//! The functions that are compiled once per lane type, for the instructions of that type.
//!
//! Everything else that is written over lanes is inlined into these. They are few and never inlined into each
//! other, since one evaluation of the dynamics is about a thousand instructions and would otherwise
//! be copied into every stage of every integrator.

use simd::{F32Array, F64Array, Lanes};

use crate::block::{self, Block};
use crate::forward_dynamics::{self, Dynamics};
use crate::model::Model;
use crate::replay::{self, Together};
use crate::spatial::Turn;
use crate::{DynamicsError, Joints};

pub(crate) trait Kernels: Lanes {
    /// See [`forward_dynamics::mass_matrix_and_bias`].
    fn mass_matrix_and_bias(
        model: &Model<Self>,
        turns: &Joints<Turn<Self>>,
        qd: &Joints<Self>,
        dynamics: &mut Dynamics<Self>,
    );

    /// See [`forward_dynamics::accelerations`].
    fn accelerations(
        model: &Model<Self>,
        dynamics: &Dynamics<Self>,
        qd: &Joints<Self>,
        torque: &Joints<Self>,
        step: Self,
        qdd: &mut Joints<Self>,
    );

    /// See [`block::simulate`].
    fn simulate(block: &mut Block<'_>) -> Result<(), DynamicsError>;

    /// See [`replay::replay`].
    fn replay(together: &mut Together<'_>);
}

macro_rules! kernels {
    ($lanes:ty $(, $features:literal)?) => {
        impl Kernels for $lanes {
            #[inline(always)]
            fn mass_matrix_and_bias(
                model: &Model<Self>,
                turns: &Joints<Turn<Self>>,
                qd: &Joints<Self>,
                dynamics: &mut Dynamics<Self>,
            ) {
                $(#[target_feature(enable = $features)])?
                #[inline(never)]
                fn compiled(
                    model: &Model<$lanes>,
                    turns: &Joints<Turn<$lanes>>,
                    qd: &Joints<$lanes>,
                    dynamics: &mut Dynamics<$lanes>,
                ) {
                    forward_dynamics::mass_matrix_and_bias(model, turns, qd, dynamics);
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(model, turns, qd, dynamics)
                }
            }

            #[inline(always)]
            fn accelerations(
                model: &Model<Self>,
                dynamics: &Dynamics<Self>,
                qd: &Joints<Self>,
                torque: &Joints<Self>,
                step: Self,
                qdd: &mut Joints<Self>,
            ) {
                $(#[target_feature(enable = $features)])?
                #[inline(never)]
                fn compiled(
                    model: &Model<$lanes>,
                    dynamics: &Dynamics<$lanes>,
                    qd: &Joints<$lanes>,
                    torque: &Joints<$lanes>,
                    step: $lanes,
                    qdd: &mut Joints<$lanes>,
                ) {
                    forward_dynamics::accelerations(model, dynamics, qd, torque, step, qdd);
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(model, dynamics, qd, torque, step, qdd)
                }
            }

            #[inline(always)]
            fn simulate(block: &mut Block<'_>) -> Result<(), DynamicsError> {
                $(#[target_feature(enable = $features)])?
                #[inline(never)]
                fn compiled(block: &mut Block<'_>) -> Result<(), DynamicsError> {
                    block::simulate::<$lanes>(block)
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(block)
                }
            }

            #[inline(always)]
            fn replay(together: &mut Together<'_>) {
                $(#[target_feature(enable = $features)])?
                #[inline(never)]
                fn compiled(together: &mut Together<'_>) {
                    replay::replay::<$lanes>(together);
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(together)
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
