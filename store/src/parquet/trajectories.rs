//! Reading trajectories. All of it blocks, like the training and evaluation that use it.

use std::ops::Range;

use arrow_array::RecordBatch;
use arrow_select::concat::concat_batches;
use parquet::errors::ParquetError;

use crate::{ShardContents, Store, StoreError, TableReader};

/// The trajectories of an open shard. Threads may share it.
#[derive(Clone, Debug)]
pub struct ShardReader {
    table: TableReader,
    /// The trajectories of each row group.
    row_groups: Vec<Range<u64>>,
    /// Number of rows of each trajectory.
    samples: u64,
}

impl Store {
    /// Opens the trajectories of a shard after checking all their bytes against their digest.
    ///
    /// # Errors
    /// When the file cannot be read, or its contents do not match its row.
    pub fn open_shard(&self, shard: &ShardContents) -> Result<ShardReader, StoreError> {
        ShardReader::new(self.open_table(&shard.trajectories)?, shard.range())
    }
}

impl ShardReader {
    /// Reads a table as `trajectories`, in order.
    ///
    /// # Errors
    /// When its rows do not form exactly these trajectories.
    pub fn new(table: TableReader, trajectories: Range<u64>) -> Result<Self, StoreError> {
        let (rows, count) = (table.rows(), trajectories.end.saturating_sub(trajectories.start));
        if count == 0 || rows == 0 || !rows.is_multiple_of(count) {
            let detail = format!("{rows} rows are not {count} whole trajectories");
            let failed = StoreError::parquet("opening", table.path());
            return Err(failed(ParquetError::General(detail)));
        }
        let samples = rows / count;
        let mut next = trajectories.start;
        let row_groups = table
            .row_groups()
            .map(|rows| {
                let first = next;
                next += rows / samples;
                first..next
            })
            .collect();
        Ok(Self { table, row_groups, samples })
    }

    /// The trajectories of each row group, as indices in their dataset.
    pub fn row_groups(&self) -> &[Range<u64>] {
        &self.row_groups
    }

    /// Number of rows of each trajectory.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// All rows of a row group, with `columns` in the given order.
    ///
    /// # Errors
    /// When the row group or a column does not exist, or the file cannot be read.
    pub fn read_row_group(
        &self,
        row_group: usize,
        columns: &[&str],
    ) -> Result<RecordBatch, StoreError> {
        self.table.read_row_group(row_group, columns)
    }

    /// The rows of `trajectories`, given as indices in their dataset.
    ///
    /// # Errors
    /// When a trajectory or a column is not in the shard, or the file cannot be read.
    pub fn read_trajectories(
        &self,
        trajectories: Range<u64>,
        columns: &[&str],
    ) -> Result<RecordBatch, StoreError> {
        let parts = self.read_parts(trajectories, columns)?;
        concatenate(parts.into_iter().map(|(_, rows)| rows).collect(), self.table.path())
    }

    /// The rows of `trajectories`, one part per row group, without copying decoded values. Each
    /// part comes with the trajectories that it holds.
    ///
    /// # Errors
    /// When a column is not in the shard, or the file cannot be read.
    pub fn read_parts(
        &self,
        trajectories: Range<u64>,
        columns: &[&str],
    ) -> Result<Vec<(Range<u64>, RecordBatch)>, StoreError> {
        let mut parts = Vec::new();
        for (i, group) in self.row_groups.iter().enumerate() {
            let part = overlap(&trajectories, group);
            if part.is_empty() {
                continue;
            }
            let rows = self.read_row_group(i, columns)?;
            let skipped = (part.start - group.start) * self.samples;
            let taken = (part.end - part.start) * self.samples;
            let position = |rows: u64| usize::try_from(rows).unwrap_or(usize::MAX);
            parts.push((part, rows.slice(position(skipped), position(taken))));
        }
        Ok(parts)
    }
}

fn overlap(a: &Range<u64>, b: &Range<u64>) -> Range<u64> {
    a.start.max(b.start)..a.end.min(b.end)
}

fn concatenate(mut parts: Vec<RecordBatch>, path: &str) -> Result<RecordBatch, StoreError> {
    let failed = StoreError::parquet("reading", path);
    match parts.len() {
        0 => Err(failed(ParquetError::General("it has none of the trajectories".to_owned()))),
        1 => Ok(parts.swap_remove(0)),
        _ => concat_batches(&parts[0].schema(), &parts)
            .map_err(|error| failed(ParquetError::from(error))),
    }
}
