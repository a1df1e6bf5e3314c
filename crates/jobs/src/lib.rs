//! Turns specs into jobs that wait for workers.
//!
//! Each kind of job has a module. It defines the job's tasks, the earlier work that it takes over,
//! and its results. The kinds are those of [`spec::for_each_kind`]. The planner and the worker
//! share the types of the tasks' payloads.
//!
//! A job is `waiting` (for jobs it needs), `queued`, `running`, `succeeded`, `failed` or
//! `cancelled`. The last three are final. A `pipeline` is a job whose members are jobs. If a
//! submitted spec's digest is already waiting, queued, running or succeeded, the submission returns
//! that job, unless `force` is given or its results were deleted.
//!
//! `store` knows no kinds, and workers read no spec for `execution`: what tasks need of it is in
//! columns of the job and the task. A submission says what a job leaves (`store::Output`) and how
//! far earlier work of the same digest can stand in for it (`store::JobReuse`).
//!
//! # Trying again and taking over
//!
//! Final states never change, so a failed job is tried again as a new job with the same spec. A new
//! evaluation takes over the completed tasks with the same digest, stage and payload, with their
//! results. This is safe because a finished task need not be done twice. The last stage, which
//! leaves the files that people download, is always done again. Workers of a simulation and of a
//! training copy the shards and checkpoints that another job of the digest has committed, if their
//! bytes are intact. `force` takes nothing over.
//!
//! # A lost database
//!
//! It is rebuilt from the files of datasets and checkpoints, which say which job made them
//! (`reindex`). Each job is submitted under its old id, and its tasks are completed with these
//! files, through the operations that workers use. No row is made in another way.

#![warn(missing_docs)]

mod checkpoints;
mod control;
mod data;
mod description;
mod error;
mod evaluate;
mod execution;
mod identify;
mod import;
mod inputs;
mod kind;
mod pipeline;
mod plan;
mod references;
mod reindex;
mod robots;
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
pub use robots::SentSpec;
pub use simulate::ShardTask;
pub use submission::{Retried, idempotency, repeated, retried, submit};
pub use verify::VerifyTask;
pub use warnings::warnings;
