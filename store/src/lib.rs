//! Persistent storage: jobs, tasks, runs, metrics, datasets, checkpoints and robots as rows in SQLite or
//! PostgreSQL, their bytes as objects, and the Parquet layout of a dataset.
//!
//! [`Store`] is the one door, and its methods lie in one file per resource. These rules hold
//! throughout:
//!
//! - *A row is the commit point.* Bytes are written, synced, digested and published first. The
//!   transaction that follows makes them exist. Anything that a crash leaves without a row is
//!   invisible and swept later.
//! - *Every write of a worker carries a [`Fence`].* It fails with [`StoreError::LeaseLost`] when
//!   the task was given to another worker meanwhile.
//! - *Moments are those of the database's clock*, and nothing ends because that clock jumps.
//! - Counts are `u64` here and 64-bit integers in SQL.
//! - *Attempts count at claim.* A task that kills its worker ends `failed` after `max_attempts`. A
//!   checkpoint of a later step begins the count anew.
//! - *A list asks the database as often for many items as for one*, and reads no files. Rows of
//!   other tables are read for all items at once. Only the last task of a job reads the results of
//!   all others.
//! - *Bytes that leave the store were compared with the digest of their row.* A whole object is
//!   digested while it is sent, and its last piece waits for the verdict. A range starts a check in
//!   the background, and a damaged object is refused from then on.
//! - What the scheduler of a cluster knows of its workers is stored nowhere else; `Placed` is for
//!   people to read. Secrets of workers are in environments, never in arguments, scripts, comments
//!   or Jobs.
//! - Asynchronous functions of the store are `boxed`. Otherwise every crate that awaits one would
//!   compile it again.
//!
//! # Floors
//!
//! *Rules* decide what happens to a task, a job and a pipeline: plain functions of plain values.
//! *Statements* read and write rows and decide nothing. *Objects* are bytes. The operations between
//! them read rows, ask the rules and write their answers, in one transaction. A random walk of a
//! million steps checks the laws of the rules on a queue in memory, and repeats the walk through a
//! store.

#![warn(missing_docs)]

mod access;
mod clock;
mod database;
mod error;
mod events;
mod identifiers;
mod lists;
mod objects;
mod parquet;
mod place;
mod queue;
mod results;
mod store;
mod tracking;
mod transfer;
mod trash;
mod workers;

/// Makes an asynchronous function return a boxed future, which only the store compiles. A future of
/// its own type is compiled again in every part of every crate that awaits it.
pub(crate) use async_recursion::async_recursion as boxed;

pub use access::audit::{AUDIT_ENTRIES, AuditEntry, AuditRecord};
pub use access::tokens::{MAX_TOKENS, NewToken, Token};
pub use clock::Timestamp;
pub use database::Duty;
pub use error::StoreError;
pub use events::{EVENTS_KEPT, EVENTS_KEPT_FOR, Event, EventFilter, EventTail};
pub use identifiers::{
    CheckpointId, DatasetId, Epoch, ExperimentId, Fence, JobId, RobotId, RunId, TaskId, TokenId,
    TrackedRunId,
};
pub use lists::census::Census;
pub use lists::labels::{Labels, MAX_TAGS};
pub use lists::listing::{Direction, Key, Listed, Listing, Position};
pub use objects::{
    Fingerprint, ObjectBytes, ObjectWriter, ObjectsUrl, Patience, RemoteObjects, S3Options,
    SignedFor, StoredObject, measure_file, path as object_path,
};
pub use parquet::description::{
    CheckpointDescription, CheckpointFileDescription, DatasetDescription, FileDescription,
    ShardDescription, TableColumns,
};
pub use parquet::file_content::FileContent;
pub use parquet::layout::{STEP, TRAJECTORY, table_schema, trajectories_per_row_group};
pub use parquet::shard_summary::{ChannelSummary, ShardSummary, Spectrum};
pub use parquet::table_reader::TableReader;
pub use parquet::table_writer::{EncodedRows, TableEncoder, TableFile, TableWriter};
pub use parquet::trajectories::ShardReader;
pub use place::data_dir::Access;
pub use place::disk::DiskSpace;
pub use place::location::{DatabaseUrl, Location};
pub use queue::attempts::Attempt;
pub use queue::idempotency::Idempotency;
pub use queue::jobs::{Job, JobFilter, JobProgress, Page};
pub use queue::leases::Lease;
pub use queue::logs::{LogChunk, LogFilter, LogPage, NewLogChunk};
pub use queue::pause::Queue;
pub use queue::pipelines::{Member, Membership};
pub use queue::reaper::{Reaped, Reaper, WorkerEnd};
pub use queue::rules::Retry;
pub use queue::statements::tasks::{ClaimedTask, IdlePoll, Progress, Task};
pub use queue::submission::{
    JobReuse, Need, NewJob, NewMember, NewPipeline, NewTask, Output, PartReuse, Reuse, Submission,
    Submitted,
};
pub use queue::takeover::EarlierShard;
pub use queue::tasks::{ResultTally, TaskOverview, TaskPage};
pub use queue::waiting::Bell;
pub use results::artifacts::{Artifact, NewArtifact};
pub use results::checkpoints::{Checkpoint, CheckpointFile, NewCheckpoint, WhichCheckpoint};
pub use results::datasets::{Dataset, Shard, ShardContents};
pub use results::metrics::{CurvePoint, Metric, MetricCurve};
pub use results::robots::{AddedRobot, NewRobot, Robot, RobotSource};
pub use results::runs::{Run, RunSummary};
pub use results::uploads::{Upload, UploadWriter};
pub use store::Store;
pub use tracking::artifacts::TrackedArtifact;
pub use tracking::experiments::TrackedExperiment;
pub use tracking::metrics::{TrackedBatch, TrackedMetric};
pub use tracking::runs::{NewTrackedRun, TrackedRun, TrackedRunChange, TrackedStatus};
pub use transfer::{StoreContents, Transfer, TransferProgress};
pub use trash::found_objects::FoundTable;
pub use trash::garbage::{Garbage, GarbageKind, Ripe};
pub use trash::inventory::ObjectPlace;
pub use trash::leftovers::{Sweeper, Swept};
pub use trash::retention::{Outdated, Retention};
pub use trash::rules::{Dependent, Item, Respect};
pub use trash::{Deleted, Deletion, DeletionOrder, TrashPlace, Trashed};
pub use wire::{
    AttemptOutcome, DatasetState, EventKind, ItemKind, JobState, LabelChange, PlacementState,
    Relation, Scope, Sort, TaskState, TextChange,
};
pub use workers::demand::{Demand, Wait};
pub use workers::duties::DutyClaim;
pub use workers::placements::{Engine, Placed, Placement};
pub use workers::{Worker, WorkerProcess, WorkersTask};
