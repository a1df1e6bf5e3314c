//! A simulation: one task per shard, which is simulated, written, published and committed.
//!
//! A shard is a function of (spec, index). It goes to one of three places through the same code:
//! objects of the store, files of a folder, or only its digests. While a row group is encoded, the
//! next is simulated, both on all threads, and a separate thread writes the one before. Memory does
//! not grow with the shard.

mod robots;
mod series;
mod shard;
mod takeover;

use jobs::ShardTask;
use spec::SimulateSpec;
use store::{FileContent, ObjectWriter, ShardContents, object_path};

use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::kinds::KindModule;

pub(crate) use shard::{ProgressCallback, SimulatedShard, VERSION, VERSION_KEY};

pub(crate) const MODULE: KindModule = KindModule { run, computes_models: false };

/// Simulates the shard of a task.
fn run(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: SimulateSpec = attempt.spec()?;
    let ShardTask { shard } = attempt.payload()?;
    if takeover::take_over(attempt)?.is_break() {
        return Ok(());
    }
    let task = &attempt.task;
    let shard = SimulatedShard::new(&spec, task.digest, shard);
    let begin = |content: FileContent| -> Result<ObjectWriter, TaskError> {
        let path = object_path::shard(task.job, task.ordinal, task.fence.epoch, content);
        Ok(attempt.wait(attempt.store.write_object(&path))?)
    };
    let progress = |done: u64| attempt.show(done);
    let (trajectories, robots) = (begin(FileContent::Trajectories)?, begin(FileContent::Robots)?);
    let written = shard.write(trajectories, robots, &progress)?;
    let ShardContents { first, count, rejected, trajectories, robots } = &written.shard;
    let bytes = trajectories.size + robots.size;
    tracing::info!(first, trajectories = count, rejected, bytes, "simulated and published");
    let result = written.summary.to_result();
    attempt.end(attempt.store.commit_shard(task.fence, &written.shard, Some(&result)))
}
