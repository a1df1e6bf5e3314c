//! Turns specs into jobs that wait for workers.
//!
//! Each kind of job has a module. It defines the job's tasks, the earlier work that it takes over,
//! and its results. The kinds are those of [`spec::for_each_kind`]. The planner and the worker
//! share the types of the tasks' payloads.

mod checkpoints;
mod control;
mod data;
mod description;
mod error;
mod evaluate;
mod execution;
mod import;
mod inputs;
mod kind;
mod pipeline;
mod plan;
mod references;
mod reindex;
mod simulate;
mod submission;
mod train;
mod verify;
mod warnings;

pub use control::ControlTask;
pub use description::describe_dataset;
pub use error::SubmissionError;
pub use evaluate::EvaluateTask;
pub use kind::{Limits, MemoryDoubts};
pub use reindex::{FoundObjects, LeftOut, Rebuilt, ReindexError, find_objects, rebuild};
pub use simulate::ShardTask;
pub use submission::{Retried, idempotency, read, repeated, retried, submit};
pub use verify::VerifyTask;
pub use warnings::warnings;
