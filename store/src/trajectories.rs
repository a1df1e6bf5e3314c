//! Reading trajectories back. All of it blocks, like the training and evaluation it serves.

use std::ops::Range;

use arrow::array::RecordBatch;
use arrow::compute::concat_batches;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder,
};
use parquet::errors::ParquetError;

use crate::objects::PositionedFile;
use crate::{Shard, Store, StoreError};

/// The trajectories of a shard, open. Threads may share it.
#[derive(Clone, Debug)]
pub struct ShardReader {
    file: PositionedFile,
    metadata: ArrowReaderMetadata,
    path: String,
    /// Trajectories of each row group.
    row_groups: Vec<Range<u64>>,
    /// Rows of each trajectory.
    samples: u64,
}

impl Store {
    /// Opens the trajectories of a shard, once all their bytes have been checked against the digest
    /// they were published with: what is read later is what was written.
    ///
    /// # Errors
    /// When the file cannot be read or does not hold what its row says.
    pub fn open_shard(&self, shard: &Shard) -> Result<ShardReader, StoreError> {
        let path = &shard.trajectories.path;
        let file = self.objects().open_verified(&shard.trajectories)?;
        let file = PositionedFile::new(file).map_err(|source| StoreError::ObjectFile {
            operation: "opening",
            path: path.clone(),
            source,
        })?;
        let metadata = ArrowReaderMetadata::load(&file, ArrowReaderOptions::new())
            .map_err(StoreError::parquet("opening", path))?;
        let rows = metadata.metadata().file_metadata().num_rows().unsigned_abs();
        if shard.count == 0 || rows == 0 || !rows.is_multiple_of(shard.count) {
            let detail = format!("{rows} rows are not {} whole trajectories", shard.count);
            return Err(StoreError::parquet("opening", path)(ParquetError::General(detail)));
        }
        let samples = rows / shard.count;
        let mut next = shard.first;
        let mut row_groups = Vec::with_capacity(metadata.metadata().num_row_groups());
        for group in metadata.metadata().row_groups() {
            let first = next;
            next += group.num_rows().unsigned_abs() / samples;
            row_groups.push(first..next);
        }
        Ok(ShardReader { file, metadata, path: path.clone(), row_groups, samples })
    }
}

impl ShardReader {
    /// The trajectories of each row group, by index in their dataset.
    pub fn row_groups(&self) -> &[Range<u64>] {
        &self.row_groups
    }

    /// Rows of each trajectory.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// All rows of a row group, with `columns` in the order asked for.
    ///
    /// # Errors
    /// When the row group or a column does not exist, or the file cannot be read.
    pub fn read_row_group(
        &self,
        row_group: usize,
        columns: &[&str],
    ) -> Result<RecordBatch, StoreError> {
        self.read(row_group, columns).map_err(StoreError::parquet("reading", &self.path))
    }

    fn read(&self, row_group: usize, columns: &[&str]) -> Result<RecordBatch, ParquetError> {
        let Some(trajectories) = self.row_groups.get(row_group) else {
            return Err(ParquetError::General(format!("it has no row group {row_group}")));
        };
        let rows = (trajectories.end - trajectories.start) * self.samples;
        let rows = usize::try_from(rows).map_err(|e| ParquetError::External(Box::new(e)))?;
        let schema = self.metadata.metadata().file_metadata().schema_descr();
        let mask = ProjectionMask::columns(schema, columns.iter().copied());
        let batches = ParquetRecordBatchReaderBuilder::new_with_metadata(
            self.file.clone(),
            self.metadata.clone(),
        )
        .with_row_groups(vec![row_group])
        .with_projection(mask)
        .with_batch_size(rows)
        .build()?
        .collect::<Result<Vec<_>, _>>()?;
        let batch = match batches.as_slice() {
            [one] => one.clone(),
            many => return Err(ParquetError::General(format!("it came in {} parts", many.len()))),
        };
        let asked = columns
            .iter()
            .map(|column| batch.schema().index_of(column))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(batch.project(&asked)?)
    }

    /// The rows of `trajectories`, by index in their dataset.
    ///
    /// # Errors
    /// When a trajectory or a column is not in the shard, or the file cannot be read.
    pub fn read_trajectories(
        &self,
        trajectories: Range<u64>,
        columns: &[&str],
    ) -> Result<RecordBatch, StoreError> {
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
            parts.push(rows.slice(position(skipped), position(taken)));
        }
        concatenate(parts, &self.path)
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
