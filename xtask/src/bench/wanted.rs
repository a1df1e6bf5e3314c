//! What of a benchmark is asked for, and what it has to say.

use clap::ValueEnum;

use super::measurement::Measurement;

/// What a benchmark has to say.
pub struct Report {
    /// What was run, in which version, on what.
    pub notes: Vec<String>,
    pub measurements: Vec<Measurement>,
}

/// What of a benchmark is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    pub peers: Peers,
    /// All unless given.
    pub size: Option<Size>,
}

/// Of the presets of networks.
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
