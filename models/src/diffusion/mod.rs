//! Noise, how it is added and how it is taken away again (Ho et al. 2020).
//!
//! Level t of T is the series √ᾱ_t x0 + √(1 - ᾱ_t) ε with x0 the clean series and ε standard
//! normal; level 0 has the least noise. [`flow`] mixes them along straight lines instead. Coefficients
//! are computed in f64 from the schedule alone ([`sampler`]), and a series is what is done with them
//! ([`Process`]).

mod flow;
#[cfg(test)]
mod known_answers;
mod mixing;
mod noise_schedule;
mod prediction;
mod process;
mod sampler;

pub(crate) use process::{Painted, Process};
pub(crate) use sampler::Step;
