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

mod artifacts;
mod attempts;
mod audit;
mod census;
mod checkpoints;
mod datasets;
mod demand;
mod dependents;
mod events;
mod garbage;
mod inventory;
mod jobs;
mod labels;
pub(super) mod line;
pub(super) mod listing;
mod logs;
mod metrics;
mod pipelines;
mod placements;
mod queue;
pub(super) mod rows;
mod runs;
mod submission;
mod takeover;
mod task_lists;
mod tasks;
mod tokens;
mod tracked_artifacts;
mod tracked_experiments;
mod tracked_metrics;
mod tracked_runs;
mod transfer;
mod trash;
mod uploads;
mod workers;

use std::time::Duration;

use super::dialect::{BY_BYTES, Db, DbRow, FIND, IS_EXPERIMENT, LISTED_IDS, LISTED_TEXTS};
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
