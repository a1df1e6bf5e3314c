//! The operations that Transformers and U-Nets spend their time in.
//!
//! Each has two forms with the same result: burn's own operations, which run on every device, and a
//! fused one for burn's CPU backend with a derivative of its own. burn-flex 0.22 computes GELU and
//! Mish in serial scalar loops, fuses softmax, norms and attention only where no gradient is
//! recorded, and writes every intermediate to memory; see `fused`.
//!
//! Products of matrices take most of the time. All are made of the tiles of `product`, whose
//! instructions are chosen at run time and which need no copy of what they multiply; the crate `gemm`
//! copies both factors first and was half as fast at these sizes.
//!
//! Most of a step is spent in here, so this is also where an [`Interrupt`] ends it.
//!
//! The fused forms give the same bits whatever thread runs which part: no sum crosses a task.

mod adam_w;
mod affine;
#[cfg(test)]
mod agreement;
mod attention;
mod conv1d;
mod conv_transpose1d;
mod correlation;
mod dropout;
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
mod norm_linear;
mod packed;
mod panels;
mod parts;
mod product;
mod softmax;
mod tanh;
mod threefry;
mod transposition;
mod vectorized;
mod windows;
mod winograd;

pub use adam_w::{AdamWStep, adam_w, is_fused, sum_of_squares};
pub use attention::{Mask, attention, self_attention};
pub use conv_transpose1d::conv_transpose1d;
pub use conv1d::{conv1d, scratch_of_conv1d};
pub use dropout::{DropoutKeys, DropoutMask, dropout};
pub use gelu_linear::gelu_linear_onto;
pub use group_norm_mish::group_norm_mish;
pub use interruption::{Interrupt, Interrupted};
pub use layer_norm::layer_norm;
pub use linear::linear;
pub use mish::mish;
pub use norm_linear::{norm_linear, norm_linear_of_three};
pub use packed::PackedWeight;
pub use tanh::tanh;
