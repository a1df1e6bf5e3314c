//! Arms from URDFs: generated chains against a direct evaluation of their trees, what is refused,
//! and damaged texts.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod agreement;
mod damaged;
mod doubts;
mod refused;
mod robots;
