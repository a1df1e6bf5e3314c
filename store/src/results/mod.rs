//! What jobs leave: datasets, runs with metrics and files, checkpoints; robots; and files that users
//! send.

pub(crate) mod artifacts;
pub(crate) mod checkpoints;
pub(crate) mod datasets;
pub(crate) mod metrics;
pub(crate) mod robots;
pub(crate) mod runs;
pub(crate) mod uploads;
