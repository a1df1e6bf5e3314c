//! Every model learns, predicts without a leak and resumes exactly. Damaged checkpoints are refused.

#![expect(clippy::unwrap_used, reason = "a test ends at what it did not expect")]

mod chain;
mod checkpoint;
mod every_architecture;
mod prediction;
#[path = "../synthetic/mod.rs"]
mod synthetic;
mod training;
