//! The fate of tasks, jobs and pipelines: functions of plain values, which know no database.
//!
//! The operations of [`Store`](crate::Store) read rows, ask these functions, and write what they
//! answer. The only conditions that SQL holds by itself are that of time (which task may be claimed) and
//! those that a row cannot tell (which jobs have a digest).

pub(crate) mod cancellation;
pub(crate) mod deletion;
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
