use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The numbers that the matrix products of a Transformer's layers read, in training and in
/// predictions. Sums, weights and everything between the products are f32, and so are the maps of
/// series to tokens and back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum MatmulPrecision {
    /// Both factors are f32.
    #[default]
    F32,
    /// Both factors of each product, in the backward pass too, are rounded to bf16, which has eight
    /// significant bits. Faster on processors with AVX-512 BF16. Devices other than `cpu` compute as
    /// with f32.
    Bf16,
}

impl MatmulPrecision {
    pub(super) fn is_default(&self) -> bool {
        *self == Self::F32
    }
}
