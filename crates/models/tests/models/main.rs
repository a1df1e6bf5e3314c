//! What every model must do: learn, predict without a leak, resume, and refuse damaged checkpoints.

#![expect(clippy::unwrap_used, reason = "a test ends at what it did not expect")]

mod checkpoint;
mod every_architecture;
mod prediction;
#[path = "../synthetic/mod.rs"]
mod synthetic;
mod training;
