//! Lists of jobs, runs, datasets and checkpoints: their order, filters, labels and counts.

pub(crate) mod census;
pub(crate) mod labels;
pub(crate) mod listing;
pub(crate) mod statements;
