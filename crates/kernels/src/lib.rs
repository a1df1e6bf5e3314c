//! The operations in which Transformers and U-Nets spend their time.
//!
//! Each has two forms with the same result, and with the feature `torch` a third. The plain form
//! consists of burn's own operations and runs on every device. The fused form runs on burn's CPU
//! backend and has its own backward pass. The third form consists of PyTorch's functions, which
//! PyTorch differentiates; see `torch`.
//! burn-flex 0.22 computes GELU and Mish in serial scalar loops, fuses softmax, norms and attention
//! only where no gradient is recorded, and writes every intermediate result to memory; see `fused`.
//!
//! Matrix products take most of the time. All use the register tiles of `product`, whose
//! instruction set is chosen at run time. They need no copy of their factors. The crate `gemm`
//! copies both factors and was half as fast at these sizes.
//!
//! Most of a step's time is spent in this crate, so this is also where an [`Interrupt`] ends it.
//!
//! The fused forms give the same bits for every number of threads, because no sum crosses a task.
//!
//! Instructions (AVX-512, AVX2 with fused multiply-adds, or neither) are chosen at run time and may
//! change the last bits. A kernel recomputes the values that it does not keep for its derivative. A
//! product reads f32, or pairs of bf16: one loop over tiles serves both.
//!
//! The device is named wherever tensors are made. burn's default is never used, because it depends
//! on the features of a build.

#![warn(missing_docs)]

mod adam_w;
mod adam_w_step;
mod affine;
#[cfg(test)]
mod agreement;
mod attention;
mod conv1d;
mod conv_transpose1d;
mod correlation;
mod dropout;
mod factors;
#[cfg(test)]
mod finite_differences;
mod fused;
mod gelu_linear;
mod group_norm_mish;
mod instruction_set;
mod interruption;
mod layer_norm;
mod linear;
mod mish;
mod norm_conv1d;
mod norm_linear;
mod packed;
mod pairs;
mod panels;
mod parts;
mod product;
mod softmax;
mod tanh;
mod threefry;
mod together;
#[cfg(feature = "torch")]
pub mod torch;
mod transposition;
mod vectorized;
mod windows;
mod winograd;

pub use adam_w::{adam_w, is_fused, sum_of_squares};
pub use adam_w_step::AdamWStep;
pub use attention::{Mask, attention, self_attention};
pub use conv_transpose1d::conv_transpose1d;
pub use conv1d::{conv1d, scratch_of_conv1d};
pub use dropout::{DropoutKeys, DropoutMask, dropout};
pub use factors::Factors;
pub use gelu_linear::gelu_linear_onto;
pub use group_norm_mish::group_norm_mish;
pub use interruption::{Interrupt, Interrupted};
pub use layer_norm::layer_norm;
pub use linear::linear;
pub use mish::mish;
pub use norm_conv1d::{PerChannel, norm_conv1d};
pub use norm_linear::{norm_linear, norm_linear_of_three};
pub use packed::{PackedKernel, PackedWeight};
pub use tanh::tanh;
pub use together::{Stepped, Together};
