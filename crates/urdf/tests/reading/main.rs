//! Arms from URDFs: generated chains against a direct evaluation of their trees, what is refused,
//! damaged texts, and the way back to URDFs and to MuJoCo.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod agreement;
mod damaged;
mod doubts;
mod mujoco;
mod refused;
mod robots;
mod written;
