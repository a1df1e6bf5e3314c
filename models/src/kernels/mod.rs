//! The operations that a Transformer spends its time in.

mod attention;
mod gelu;
mod layer_norm;
mod linear;

pub(crate) use attention::{Mask, attention};
pub(crate) use gelu::gelu;
pub(crate) use layer_norm::layer_norm;
pub(crate) use linear::linear;
