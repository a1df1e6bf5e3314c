//! The queue: jobs and their tasks, from the submission to the end of the last attempt.

pub(crate) mod attempts;
pub(crate) mod cancellation;
pub(crate) mod fences;
pub(crate) mod idempotency;
pub(crate) mod jobs;
pub(crate) mod leases;
pub(crate) mod logs;
pub(crate) mod pause;
pub(crate) mod pipelines;
pub(crate) mod propagation;
pub(crate) mod reaper;
pub(crate) mod rules;
pub(crate) mod statements;
pub(crate) mod submission;
pub(crate) mod takeover;
pub(crate) mod task_end;
pub(crate) mod tasks;
pub(crate) mod waiting;
