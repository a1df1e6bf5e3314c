//! The options and the results of a benchmark.

use std::num::NonZeroUsize;

use clap::ValueEnum;

use super::measurement::Measurement;

/// The results of a benchmark.
pub struct BenchmarkResults {
    /// Programs, their versions and the machine.
    pub notes: Vec<String>,
    pub measurements: Vec<Measurement>,
}

/// The options of a benchmark.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    pub peers: Peers,
    /// Only networks of this size; all without it.
    pub size: Option<Size>,
    /// Rounds of every network; without it as many as its size needs.
    pub rounds: Option<NonZeroUsize>,
}

/// The size of the networks' presets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Size {
    Small,
    Paper,
}

/// Whether other programs are measured beside ours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Peers {
    LeftOut,
    Measured,
}
