//! Runs that MLflow's clients record: experiments, parameters, metrics and files.

pub(crate) mod artifacts;
pub(crate) mod experiments;
pub(crate) mod metrics;
pub(crate) mod runs;
