//! The states of tasks, jobs and pipelines: functions of plain values, without a database.
//!
//! The operations of [`Store`](crate::Store) read rows, call these functions and write the results.
//! SQL itself holds only two kinds of conditions: conditions of time (which task may be claimed),
//! and conditions that one row cannot answer (which jobs have a digest).

pub(crate) mod cancellation;
pub(crate) mod job;
pub(crate) mod pipeline;
pub(crate) mod placement;
pub(crate) mod reuse;
pub(crate) mod task;
pub(crate) mod turn;
pub(crate) mod watch;

#[cfg(test)]
mod queue;

pub use task::Retry;
