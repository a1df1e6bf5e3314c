//! A shard: simulated, written, published, committed.

mod robots;
mod series;

use std::collections::BTreeMap;
use std::ops::{ControlFlow, Range};

use dynamics::{DynamicsError, Trajectories};
use spec::SimulateSpec;
use store::{FileContent, NewShard, TableWriter, object_path};

use crate::attempt::Attempt;
use crate::error::TaskError;

pub(crate) use series::{POSITIONS, TORQUES};

/// Simulates one shard, a row group at a time, so that memory does not grow with the shard.
pub(crate) fn shard(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: SimulateSpec = attempt.spec()?;
    let range = spec.shard(u64::from(attempt.task.ordinal));
    let mut files = ShardFiles::create(attempt, &spec, &range)?;
    let mut rejected = 0;
    let group = u64::from(store::trajectories_per_row_group(spec.samples));
    let mut first = range.start;
    while first < range.end {
        let part = first..(first + group).min(range.end);
        first = part.end;
        let simulated = simulate(attempt, &spec, part, range.start)?;
        rejected += simulated.rejected;
        files.trajectories.write(series::record_batch(&simulated)?)?;
        files.robots.write(robots::record_batch(&simulated.scenarios)?)?;
    }
    let shard = NewShard {
        first: range.start,
        count: range.end - range.start,
        rejected,
        trajectories: files.trajectories.finish()?,
        robots: files.robots.finish()?,
    };
    attempt.wait(attempt.store.commit_shard(attempt.fence(), &shard, None))?;
    Ok(())
}

/// Trajectories `part` of a shard that begins at `start`.
fn simulate(
    attempt: &Attempt,
    spec: &SimulateSpec,
    part: Range<u64>,
    start: u64,
) -> Result<Trajectories, TaskError> {
    let done_before = part.start - start;
    let progress = |done: u64| {
        attempt.progress.set_done(done_before + done);
        match attempt.stop.get() {
            Some(_) => ControlFlow::Break(()),
            None => ControlFlow::Continue(()),
        }
    };
    attempt.check_stop()?;
    dynamics::simulate(spec, part, &progress).map_err(|error| match error {
        DynamicsError::Cancelled { .. } => TaskError::Stopped,
        other => other.into(),
    })
}

/// The two files of a shard, being written.
struct ShardFiles {
    trajectories: TableWriter,
    robots: TableWriter,
}

impl ShardFiles {
    fn create(
        attempt: &Attempt,
        spec: &SimulateSpec,
        range: &Range<u64>,
    ) -> Result<Self, TaskError> {
        let (task, store) = (&attempt.task, &attempt.store);
        let footer = footer(attempt, range);
        let path = |content| object_path::shard(task.job, task.ordinal, task.fence.epoch, content);
        let trajectories = path(FileContent::Trajectories);
        let robots = path(FileContent::Robots);
        let schema = store::trajectory_schema(TORQUES.into_iter().chain(POSITIONS));
        let trajectories = store.write_trajectories(&trajectories, schema, spec.samples, &footer);
        let robots_schema = robots::record_batch(&[])?.schema();
        let robots = store.write_table(&robots, robots_schema, &footer);
        Ok(Self { trajectories: attempt.wait(trajectories)?, robots: attempt.wait(robots)? })
    }
}

/// What a file says of itself: enough to make it again, byte for byte.
fn footer(attempt: &Attempt, range: &Range<u64>) -> BTreeMap<String, String> {
    let entries = [
        ("torqued.spec", attempt.task.spec.to_string()),
        ("torqued.digest", attempt.task.digest.to_string()),
        ("torqued.trajectories", format!("{}..{}", range.start, range.end)),
        ("torqued.version", env!("CARGO_PKG_VERSION").to_owned()),
        ("torqued.units", "u: N·m; q: rad; rows are sampled at rate_hz of the spec".to_owned()),
    ];
    entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}
