//! Statements about jobs, tasks and their leases.

pub(crate) mod line;
pub(crate) mod submission;
pub(crate) mod tasks;
