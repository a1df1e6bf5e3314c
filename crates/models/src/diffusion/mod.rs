//! Diffusion: how noise is added and how it is removed (Ho et al. 2020).
//!
//! Level t of T is the series √ᾱ_t x0 + √(1 - ᾱ_t) ε with x0 the clean series and ε standard
//! normal. Level 0 has the least noise. [`flow`] mixes them along straight lines instead.
//! [`sampler`] computes all coefficients in f64 from the schedule alone, and [`Process`] applies
//! them to series.

mod flow;
#[cfg(test)]
mod known_answers;
mod mixing;
mod noise_schedule;
mod process;
mod sampler;

pub(crate) use process::{Painted, Process};
pub(crate) use sampler::Step;
