//! A shard of a simulation. It depends only on the spec and the shard's index, so its bytes are
//! always the same.

use std::collections::BTreeMap;
use std::ops::{ControlFlow, Range};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use arrow_schema::SchemaRef;
use dynamics::{DynamicsError, InstructionSet, Trajectories};
use spec::{Column, DataSpec, Digest, SimulateSpec};
use store::{
    EncodedRows, ObjectWriter, ShardContents, ShardSummary, TableEncoder, TableFile, TableWriter,
};

use super::{robots, series};
use crate::error::TaskError;
use crate::summary::SummaryBuilder;

/// A callback that gets the number of finished trajectories, and stops the work by breaking.
pub(crate) type ProgressCallback<'a> = &'a (dyn Fn(u64) -> ControlFlow<()> + Sync);

/// The version that is written into files.
pub(crate) const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The key of the version in the footer.
pub(crate) const VERSION_KEY: &str = "torqued.version";

/// A shard, given by its simulation and its index.
#[derive(Clone, Debug)]
pub(crate) struct SimulatedShard<'a> {
    spec: &'a SimulateSpec,
    /// The digest that identifies the dataset.
    digest: Digest,
    trajectories: Range<u64>,
    trajectory_schema: SchemaRef,
    robot_schema: SchemaRef,
}

/// A shard that was written.
pub(crate) struct WrittenShard {
    pub shard: ShardContents,
    pub summary: ShardSummary,
}

/// Row groups that are being sent to the disk.
enum Encoded {
    Trajectories(EncodedRows),
    Robots(EncodedRows),
}

/// Number of row groups that wait for the disk. With those that are being written and encoded, they
/// take a few dozen megabytes.
const WAITING: usize = 1;

impl<'a> SimulatedShard<'a> {
    pub fn new(spec: &'a SimulateSpec, digest: Digest, index: u32) -> Self {
        Self {
            spec,
            digest,
            trajectories: spec.shard(u64::from(index)),
            trajectory_schema: store::table_schema(&spec.trajectory_columns()),
            robot_schema: store::table_schema(&spec.robot_columns()),
        }
    }

    pub fn trajectories(&self) -> Range<u64> {
        self.trajectories.clone()
    }

    pub fn samples(&self) -> u32 {
        self.spec.samples
    }

    pub fn trajectory_schema(&self) -> &SchemaRef {
        &self.trajectory_schema
    }

    pub fn robot_schema(&self) -> &SchemaRef {
        &self.robot_schema
    }

    /// Simulates the shard and writes its two tables.
    ///
    /// Simulation, encoding and writing overlap. While a row group is encoded, the next one is
    /// simulated, both on the threads of the current rayon pool. A separate thread writes the one
    /// before. Memory does not grow with the shard.
    ///
    /// # Errors
    /// [`TaskError::Stopped`] when `progress` breaks. After this or any other error, nothing is
    /// published.
    pub fn write(
        &self,
        trajectories: ObjectWriter,
        robots: ObjectWriter,
        progress: ProgressCallback<'_>,
    ) -> Result<WrittenShard, TaskError> {
        let spec = self.spec;
        let footer = self.footer(&spec.trajectory_columns())?;
        let schema = self.trajectory_schema.clone();
        let trajectories = TableWriter::trajectories(trajectories, schema, spec.samples, &footer)?;
        let footer = self.footer(&spec.robot_columns())?;
        let robots = TableWriter::table(robots, self.robot_schema.clone(), &footer)?;
        let (mut trajectories, trajectory_file) = trajectories.split();
        let (mut robots, robot_file) = robots.split();
        let (made, files) = thread::scope(|scope| {
            let (send, receive) = sync_channel(WAITING);
            let disk = scope.spawn(|| write_all(receive, trajectory_file, robot_file));
            let made = self.make(&mut trajectories, &mut robots, progress, &{ send });
            (made, disk.join())
        });
        let files = files.map_err(|_| TaskError::Panicked("the disk's thread".to_owned()))?;
        // If the disk failed, it is also the reason why no more was made.
        let (trajectory_file, robot_file) = files?;
        let summary = made?;
        let Range { start, end } = self.trajectories;
        let shard = ShardContents {
            first: start,
            count: end - start,
            rejected: summary.rejected,
            trajectories: trajectory_file.finish()?,
            robots: robot_file.finish()?,
        };
        Ok(WrittenShard { shard, summary })
    }

    /// Simulates, encodes and sends until all is done or the receiver is gone.
    fn make(
        &self,
        trajectories: &mut TableEncoder,
        robots: &mut TableEncoder,
        progress: ProgressCallback<'_>,
        send: &SyncSender<Encoded>,
    ) -> Result<ShardSummary, TaskError> {
        let mut summary = SummaryBuilder::new(self.spec.samples, self.spec.rate_hz)
            .beginning_at(self.trajectories.start);
        let mut parts = self.parts();
        let (mut current, mut ahead) = (Trajectories::default(), Trajectories::default());
        let mut pending = self.simulate_next(&mut parts, progress, &mut current)?;
        while pending.is_continue() {
            let (next, encoded) = rayon::join(
                || self.simulate_next(&mut parts, progress, &mut ahead),
                || {
                    summary.add_rejected(current.rejected);
                    let rows = series::record_batch(&self.trajectory_schema, &current)?;
                    summary.add(&rows);
                    let scenarios = &current.scenarios;
                    let table = robots::record_batch(&self.robot_schema, self.spec, scenarios)?;
                    summary.add_arms(&table);
                    let encoded = trajectories.encode(rows)?.into_iter().map(Encoded::Trajectories);
                    let table = robots.encode(table)?.into_iter().map(Encoded::Robots);
                    Ok::<_, TaskError>(encoded.chain(table).collect::<Vec<_>>())
                },
            );
            for rows in encoded? {
                if send.send(rows).is_err() {
                    return Ok(summary.finish());
                }
            }
            pending = next?;
            std::mem::swap(&mut current, &mut ahead);
        }
        let rest = trajectories.encode_rest()?.map(Encoded::Trajectories);
        for rows in rest.into_iter().chain(robots.encode_rest()?.map(Encoded::Robots)) {
            if send.send(rows).is_err() {
                break;
            }
        }
        Ok(summary.finish())
    }

    /// The trajectories of each row group.
    pub fn parts(&self) -> impl Iterator<Item = Range<u64>> + use<> {
        let Range { start, end } = self.trajectories;
        let size = u64::from(store::trajectories_per_row_group(self.spec.samples));
        (0..).map(move |k| start + k * size).take_while(move |first| *first < end).map(
            move |first| {
                let last = (first + size).min(end);
                first..last
            },
        )
    }

    /// Breaks when there are no more parts.
    fn simulate_next(
        &self,
        parts: &mut impl Iterator<Item = Range<u64>>,
        progress: ProgressCallback<'_>,
        into: &mut Trajectories,
    ) -> Result<ControlFlow<()>, TaskError> {
        let Some(part) = parts.next() else { return Ok(ControlFlow::Break(())) };
        self.simulate(part, progress, into)?;
        Ok(ControlFlow::Continue(()))
    }

    /// Simulates trajectories of this shard, reusing the memory of earlier ones.
    pub fn simulate(
        &self,
        part: Range<u64>,
        progress: ProgressCallback<'_>,
        into: &mut Trajectories,
    ) -> Result<(), TaskError> {
        let done_before = part.start - self.trajectories.start;
        let progress = |done: u64| progress(done_before + done);
        if progress(0).is_break() {
            return Err(TaskError::Stopped);
        }
        dynamics::simulate_into(InstructionSet::best(), self.spec, part, &progress, into).map_err(
            |error| match error {
                DynamicsError::Cancelled { .. } => TaskError::Stopped,
                other => other.into(),
            },
        )
    }

    /// The rows of the table of trajectories.
    pub fn trajectory_rows(
        &self,
        simulated: &Trajectories,
    ) -> Result<arrow_array::RecordBatch, TaskError> {
        Ok(series::record_batch(&self.trajectory_schema, simulated)?)
    }

    /// The rows of the table of robots.
    pub fn robot_rows(
        &self,
        simulated: &Trajectories,
    ) -> Result<arrow_array::RecordBatch, TaskError> {
        Ok(robots::record_batch(&self.robot_schema, self.spec, &simulated.scenarios)?)
    }

    /// The file's metadata: enough to make it again, byte for byte.
    fn footer(&self, columns: &[Column]) -> Result<BTreeMap<String, String>, TaskError> {
        let spec = DataSpec::Simulation(self.spec.clone()).job().to_json().to_string();
        let Range { start, end } = self.trajectories;
        let entries = [
            ("torqued.spec", spec),
            ("torqued.digest", self.digest.to_string()),
            ("torqued.trajectories", format!("{start}..{end}")),
            ("torqued.columns", serde_json::to_string(columns)?),
            (VERSION_KEY, VERSION.to_owned()),
        ];
        Ok(entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
    }
}

/// Writes the row groups that it receives, until no more come.
fn write_all(
    rows: Receiver<Encoded>,
    mut trajectories: TableFile,
    mut robots: TableFile,
) -> Result<(TableFile, TableFile), TaskError> {
    for rows in rows {
        match rows {
            Encoded::Trajectories(rows) => trajectories.append(rows)?,
            Encoded::Robots(rows) => robots.append(rows)?,
        }
    }
    Ok((trajectories, robots))
}
