//! Persistent storage: jobs, tasks, runs, metrics, datasets and checkpoints as rows in SQLite or
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

#![expect(
    clippy::duplicate_mod,
    reason = "the statements are compiled for each database, with the SQL that it has of its own"
)]

mod artifacts;
mod attempts;
mod audit;
mod cancellation;
mod census;
mod checkpoints;
mod clock;
mod columns;
mod data_dir;
mod database;
mod datasets;
mod demand;
mod dependents;
mod description;
mod duties;
mod error;
mod events;
mod found_objects;
mod garbage;
mod health;
mod idempotency;
mod identifiers;
mod identity;
mod inventory;
mod jobs;
mod labels;
mod leases;
mod leftovers;
mod listing;
mod location;
mod logs;
mod metrics;
mod new_place;
mod objects;
mod parquet_layout;
mod patience;
mod pipelines;
mod placements;
mod postgres;
mod propagation;
mod queue;
mod reaper;
mod retention;
mod rules;
mod runs;
mod shard_summary;
mod sqlite;
mod store;
mod submission;
mod table_reader;
mod table_writer;
mod takeover;
mod task_end;
mod tasks;
mod tokens;
mod tracked_artifacts;
mod tracked_experiments;
mod tracked_metrics;
mod tracked_runs;
mod trajectories;
mod transfer;
mod trash;
mod uploads;
mod waiting;
mod workers;

/// Makes an asynchronous function return a boxed future, which only the store compiles. A future of
/// its own type is compiled again in every part of every crate that awaits it.
pub(crate) use async_recursion::async_recursion as boxed;

pub use artifacts::{Artifact, NewArtifact};
pub use attempts::Attempt;
pub use audit::{AUDIT_ENTRIES, AuditEntry, AuditRecord};
pub use census::Census;
pub use checkpoints::{Checkpoint, CheckpointFile, NewCheckpoint, WhichCheckpoint};
pub use clock::Timestamp;
pub use data_dir::Access;
pub use datasets::{Dataset, FileContent, Shard, ShardContents};
pub use demand::{Demand, Wait};
pub use dependents::Dependent;
pub use description::{
    CheckpointDescription, CheckpointFileDescription, DatasetDescription, FileDescription,
    ShardDescription, TableColumns,
};
pub use duties::{Duty, DutyClaim};
pub use error::StoreError;
pub use events::{EVENTS_KEPT, EVENTS_KEPT_FOR, Event, EventFilter, EventTail};
pub use found_objects::FoundTable;
pub use garbage::{Garbage, GarbageKind, Ripe};
pub use health::DiskSpace;
pub use idempotency::Idempotency;
pub use identifiers::{
    CheckpointId, DatasetId, Epoch, ExperimentId, JobId, RunId, TaskId, TokenId, TrackedRunId,
};
pub use inventory::ObjectPlace;
pub use jobs::{Job, JobFilter, JobProgress, Page};
pub use labels::{Labels, MAX_TAGS, Thing};
pub use leases::{ClaimedTask, Fence, IdlePoll, Lease, Progress};
pub use leftovers::{Sweeper, Swept};
pub use listing::{Direction, Key, Listed, Listing, Position, Sort};
pub use location::{DatabaseUrl, Location};
pub use logs::{LogChunk, LogFilter, LogPage, NewLogChunk};
pub use metrics::{CurvePoint, Metric, MetricCurve};
pub use objects::{
    Fingerprint, ObjectBytes, ObjectWriter, ObjectsUrl, Patience, RemoteObjects, S3Options,
    SignedFor, StoredObject, measure_file, path as object_path,
};
pub use parquet_layout::{STEP, TRAJECTORY, table_schema, trajectories_per_row_group};
pub use pipelines::Member;
pub use placements::{Engine, Placed, Placement};
pub use queue::Queue;
pub use reaper::{Reaped, Reaper, WorkerEnd};
pub use retention::{Outdated, Retention};
pub use rules::Retry;
pub use runs::Run;
pub use shard_summary::{ChannelSummary, ShardSummary, Spectrum};
pub use store::Store;
pub use submission::{
    JobReuse, Need, NewJob, NewMember, NewPipeline, NewTask, Output, PartReuse, Reuse, Submission,
    Submitted,
};
pub use table_reader::TableReader;
pub use table_writer::{EncodedRows, TableEncoder, TableFile, TableWriter};
pub use takeover::EarlierShard;
pub use tasks::{ResultTally, Task, TaskOverview, TaskPage};
pub use tokens::{MAX_TOKENS, NewToken, Token};
pub use tracked_artifacts::TrackedArtifact;
pub use tracked_experiments::TrackedExperiment;
pub use tracked_metrics::{TrackedBatch, TrackedMetric};
pub use tracked_runs::{NewTrackedRun, TrackedRun, TrackedRunChange, TrackedStatus};
pub use trajectories::ShardReader;
pub use transfer::{StoreContents, Transfer, TransferProgress};
pub use trash::{Deleted, Deletion, DeletionOrder, Item, Respect, TrashPlace, Trashed};
pub use uploads::{Upload, UploadWriter};
pub use waiting::Bell;
pub use wire::{
    AttemptOutcome, DatasetState, EventKind, ItemKind, JobState, LabelChange, PlacementState,
    Relation, Scope, TaskState, TextChange,
};
pub use workers::{Worker, WorkerProcess, WorkersTask};
