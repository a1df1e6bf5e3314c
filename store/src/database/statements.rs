//! The SQL statements, with one file per resource, in the SQL that all our databases share.
//!
//! This folder is compiled once for each database, as a module of it. Where databases differ, a
//! statement uses a macro of the database's `dialect`. A function is one statement, or a few that
//! belong together. It makes no decisions: its conditions are about time, identity and the query of
//! a list.
//!
//! These rules keep the statements portable. Parameters are numbered (`$1`). Integers have 64 bits
//! and a sign (`rows::number`). Booleans are not compared with anything (`WHERE NOT is_part`). Sums
//! are cast to `BIGINT`. A column beside an aggregate is always grouped by.

/// Whether a job or one of its results was deleted. It then stands in for no other job, and nobody
/// can read its results.
macro_rules! is_gone {
    ($job:literal) => {
        concat!(
            "(", $job, ".deleted_at IS NOT NULL \
             OR EXISTS (SELECT 1 FROM dataset WHERE dataset.job = ", $job, ".id \
                 AND dataset.deleted_at IS NOT NULL) \
             OR EXISTS (SELECT 1 FROM run WHERE run.job = ", $job, ".id AND run.deleted_at IS NOT NULL) \
             OR EXISTS (SELECT 1 FROM checkpoint WHERE checkpoint.job = ", $job, ".id \
                 AND checkpoint.deleted_at IS NOT NULL AND (checkpoint.is_final OR checkpoint.is_best)))"
        )
    };
}

#[path = "../results/statements/artifacts.rs"]
mod artifacts;
#[path = "../queue/statements/attempts.rs"]
mod attempts;
#[path = "../access/statements/audit.rs"]
mod audit;
#[path = "../lists/statements/census.rs"]
mod census;
#[path = "../results/statements/checkpoints.rs"]
mod checkpoints;
#[path = "../results/statements/datasets.rs"]
mod datasets;
#[path = "../workers/statements/demand.rs"]
mod demand;
#[path = "../trash/statements/dependents.rs"]
mod dependents;
#[path = "../events/statements.rs"]
mod events;
#[path = "../trash/statements/garbage.rs"]
mod garbage;
#[path = "../trash/statements/inventory.rs"]
mod inventory;
#[path = "../queue/statements/jobs.rs"]
mod jobs;
#[path = "../lists/statements/labels.rs"]
mod labels;
#[path = "../queue/statements/line.rs"]
pub(super) mod line;
#[path = "../lists/statements/listing.rs"]
pub(super) mod listing;
#[path = "../queue/statements/logs.rs"]
mod logs;
#[path = "../results/statements/metrics.rs"]
mod metrics;
#[path = "../queue/statements/pipelines.rs"]
mod pipelines;
#[path = "../workers/statements/placements.rs"]
mod placements;
#[path = "../queue/statements/pause.rs"]
mod queue;
#[path = "rows.rs"]
pub(super) mod rows;
#[path = "../results/statements/runs.rs"]
mod runs;
#[path = "../queue/statements/submission.rs"]
mod submission;
#[path = "../queue/statements/takeover.rs"]
mod takeover;
#[path = "../queue/statements/task_lists.rs"]
mod task_lists;
#[path = "../queue/statements/tasks.rs"]
mod tasks;
#[path = "../access/statements/tokens.rs"]
mod tokens;
#[path = "../tracking/statements/artifacts.rs"]
mod tracked_artifacts;
#[path = "../tracking/statements/experiments.rs"]
mod tracked_experiments;
#[path = "../tracking/statements/metrics.rs"]
mod tracked_metrics;
#[path = "../tracking/statements/runs.rs"]
mod tracked_runs;
#[path = "../transfer/statements.rs"]
mod transfer;
#[path = "../trash/statements/trash.rs"]
mod trash;
#[path = "../results/statements/uploads.rs"]
mod uploads;
#[path = "../workers/statements/workers.rs"]
mod workers;

use std::time::Duration;

use super::dialect::{
    BY_BYTES, Db, DbRow, FIND, IS_EXPERIMENT, LISTED_IDS, LISTED_TEXTS, number_in,
};
use super::{Database, Transaction};

/// A count as SQL's integer. Counts come from checked specs and from sizes of files, and are far
/// below 2^63.
fn integer(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

/// A duration in milliseconds, which is the unit of `now!`.
pub(super) fn milliseconds(duration: Duration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX / 2)
}
