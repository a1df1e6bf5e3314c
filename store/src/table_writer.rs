//! Writes a Parquet table straight into an object, one row group in memory at a time.

use std::collections::BTreeMap;

use arrow::array::RecordBatch;
use arrow::compute::concat_batches;
use arrow::datatypes::SchemaRef;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_writer::ArrowWriterOptions;
use parquet::errors::ParquetError;

use crate::parquet_layout::writer_properties;
use crate::{ObjectWriter, Store, StoreError, StoredObject, trajectories_per_row_group};

/// Rows of a table that is not made of trajectories.
const ROWS_PER_ROW_GROUP: usize = 10_000;

/// The bytes are a function of the rows and the footer: never of how rows came in batches.
///
/// Blocks, as [`ObjectWriter`] does.
pub struct TableWriter {
    writer: ArrowWriter<ObjectWriter>,
    path: String,
    schema: SchemaRef,
    rows_per_row_group: usize,
    pending: Vec<RecordBatch>,
    pending_rows: usize,
}

impl Store {
    /// Begins the trajectories of a shard: `schema` as [`crate::trajectory_schema`] makes it, each
    /// trajectory with `samples` rows. `footer` goes into the file's key-value metadata.
    ///
    /// # Errors
    /// When the disk is full or fails.
    pub async fn write_trajectories(
        &self,
        path: &str,
        schema: SchemaRef,
        samples: u32,
        footer: &BTreeMap<String, String>,
    ) -> Result<TableWriter, StoreError> {
        let rows = u64::from(trajectories_per_row_group(samples)) * u64::from(samples);
        let rows = usize::try_from(rows).unwrap_or(usize::MAX);
        TableWriter::new(self.write_object(path).await?, schema, rows, footer)
    }

    /// Begins a table with a row per trajectory, or any other.
    ///
    /// # Errors
    /// When the disk is full or fails.
    pub async fn write_table(
        &self,
        path: &str,
        schema: SchemaRef,
        footer: &BTreeMap<String, String>,
    ) -> Result<TableWriter, StoreError> {
        TableWriter::new(self.write_object(path).await?, schema, ROWS_PER_ROW_GROUP, footer)
    }
}

impl TableWriter {
    fn new(
        object: ObjectWriter,
        schema: SchemaRef,
        rows_per_row_group: usize,
        footer: &BTreeMap<String, String>,
    ) -> Result<Self, StoreError> {
        let path = object.path().to_owned();
        let failed = || StoreError::parquet("starting", &path);
        let properties = writer_properties(&schema, rows_per_row_group, footer).map_err(failed())?;
        // The schema that arrow would add to the footer holds maps, whose order is not fixed.
        let options = ArrowWriterOptions::new()
            .with_properties(properties)
            .with_skip_arrow_metadata(true)
            .with_schema_root("schema".to_owned());
        let writer =
            ArrowWriter::try_new_with_options(object, schema.clone(), options).map_err(failed())?;
        Ok(Self { writer, path, schema, rows_per_row_group, pending: Vec::new(), pending_rows: 0 })
    }

    /// Takes rows in order; full row groups are encoded at once.
    ///
    /// # Errors
    /// When the disk is full or fails, or the batch has another schema.
    pub fn write(&mut self, batch: RecordBatch) -> Result<(), StoreError> {
        self.pending_rows += batch.num_rows();
        self.pending.push(batch);
        while self.pending_rows >= self.rows_per_row_group {
            self.write_row_group(self.rows_per_row_group)?;
        }
        Ok(())
    }

    /// Writes what is left and publishes the file.
    ///
    /// # Errors
    /// When the disk is full or fails; nothing lies under the path then.
    pub fn finish(mut self) -> Result<StoredObject, StoreError> {
        if self.pending_rows > 0 {
            self.write_row_group(self.pending_rows)?;
        }
        let object =
            self.writer.into_inner().map_err(StoreError::parquet("writing", &self.path))?;
        object.finish()
    }

    /// Pages are cut per batch, so each row group goes to the encoder as one batch.
    fn write_row_group(&mut self, rows: usize) -> Result<(), StoreError> {
        let failed = || StoreError::parquet("writing", &self.path);
        let pending = match self.pending.as_slice() {
            [one] => one.clone(),
            many => concat_batches(&self.schema, many)
                .map_err(|error| failed()(ParquetError::from(error)))?,
        };
        self.writer.write(&pending.slice(0, rows)).map_err(failed())?;
        self.writer.flush().map_err(failed())?;
        self.pending_rows -= rows;
        self.pending = match self.pending_rows {
            0 => Vec::new(),
            left => vec![pending.slice(rows, left)],
        };
        Ok(())
    }
}
