//! The formats of factors.

/// The numbers that matrix products read their factors as. Sums are f32 for both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Factors {
    /// 32-bit floats.
    #[default]
    F32,
    /// Factors are rounded to bf16, with eight significant bits instead of 24. Processors with
    /// AVX-512 BF16 multiply these twice as fast. The plain forms of operations read f32.
    Bf16,
}
