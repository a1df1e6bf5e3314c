//! Writes a Parquet table straight into an object, with a few row groups in memory at a time.

use std::collections::BTreeMap;
use std::sync::Arc;

use arrow_array::RecordBatch;
use arrow_schema::SchemaRef;
use arrow_select::concat::concat_batches;
use parquet::arrow::ArrowSchemaConverter;
use parquet::arrow::arrow_writer::{
    ArrowColumnChunk, ArrowColumnWriter, ArrowRowGroupWriterFactory, compute_leaves,
};
use parquet::errors::ParquetError;
use parquet::file::writer::SerializedFileWriter;
use rayon::prelude::*;

use crate::boxed;
use crate::parquet::layout::writer_properties;
use crate::{ObjectWriter, Store, StoreError, StoredObject, trajectories_per_row_group};

/// Rows per row group of a table that does not hold trajectories.
const ROWS_PER_ROW_GROUP: usize = 10_000;

/// Writes a Parquet table. Its bytes depend only on the rows and the footer. They do not depend on
/// the batches in which rows came, or on the number of threads that encode them.
///
/// It blocks, like [`ObjectWriter`].
pub struct TableWriter {
    encoder: TableEncoder,
    file: TableFile,
}

/// The half of a [`TableWriter`] that computes. Columns are encoded in parallel, on the threads of
/// the current rayon pool.
pub struct TableEncoder {
    factory: ArrowRowGroupWriterFactory,
    schema: SchemaRef,
    path: String,
    rows_per_row_group: usize,
    pending: Vec<RecordBatch>,
    pending_rows: usize,
}

/// The half of a [`TableWriter`] that waits for the disk.
pub struct TableFile {
    writer: SerializedFileWriter<ObjectWriter>,
    path: String,
}

/// An encoded row group, ready to be written.
pub struct EncodedRows {
    columns: Vec<ArrowColumnChunk>,
}

impl Store {
    /// Begins a table that does not hold trajectories, e.g. one with a row per trajectory.
    ///
    /// # Errors
    /// When the disk is full or fails.
    #[boxed]
    pub async fn write_table(
        &self,
        path: &str,
        schema: SchemaRef,
        footer: &BTreeMap<String, String>,
    ) -> Result<TableWriter, StoreError> {
        TableWriter::table(self.write_object(path).await?, schema, footer)
    }
}

impl TableWriter {
    /// A table of trajectories with `samples` rows each. `schema` comes from
    /// [`crate::table_schema`]. `footer` goes into the file's key-value metadata.
    ///
    /// # Errors
    /// When the disk is full or fails.
    pub fn trajectories(
        object: ObjectWriter,
        schema: SchemaRef,
        samples: u32,
        footer: &BTreeMap<String, String>,
    ) -> Result<Self, StoreError> {
        let rows = u64::from(trajectories_per_row_group(samples)) * u64::from(samples);
        Self::new(object, schema, usize::try_from(rows).unwrap_or(usize::MAX), footer)
    }

    /// A table that does not hold trajectories, e.g. one with a row per trajectory.
    ///
    /// # Errors
    /// When the disk is full or fails.
    pub fn table(
        object: ObjectWriter,
        schema: SchemaRef,
        footer: &BTreeMap<String, String>,
    ) -> Result<Self, StoreError> {
        Self::new(object, schema, ROWS_PER_ROW_GROUP, footer)
    }

    fn new(
        object: ObjectWriter,
        schema: SchemaRef,
        rows_per_row_group: usize,
        footer: &BTreeMap<String, String>,
    ) -> Result<Self, StoreError> {
        let path = object.path().to_owned();
        let failed = || StoreError::parquet("starting", &path);
        let properties = writer_properties(&schema, rows_per_row_group, footer).map_err(failed())?;
        // The footer does not get the schema that arrow would add, because it holds maps in no
        // fixed order.
        let columns =
            ArrowSchemaConverter::new().schema_root("schema").convert(&schema).map_err(failed())?;
        let writer =
            SerializedFileWriter::new(object, columns.root_schema_ptr(), Arc::new(properties))
                .map_err(failed())?;
        let encoder = TableEncoder {
            factory: ArrowRowGroupWriterFactory::new(&writer, Arc::clone(&schema)),
            schema,
            path: path.clone(),
            rows_per_row_group,
            pending: Vec::new(),
            pending_rows: 0,
        };
        Ok(Self { encoder, file: TableFile { writer, path } })
    }

    /// Takes rows in order. Full row groups are encoded at once.
    ///
    /// # Errors
    /// When the disk is full or fails, or the batch has another schema.
    pub fn write(&mut self, batch: RecordBatch) -> Result<(), StoreError> {
        for rows in self.encoder.encode(batch)? {
            self.file.append(rows)?;
        }
        Ok(())
    }

    /// Writes the remaining rows and publishes the file.
    ///
    /// # Errors
    /// When the disk is full or fails. Nothing lies under the path then.
    pub fn finish(mut self) -> Result<StoredObject, StoreError> {
        if let Some(rows) = self.encoder.encode_rest()? {
            self.file.append(rows)?;
        }
        self.file.finish()
    }

    /// Splits the writer into its halves, so that one thread can encode while another writes.
    pub fn split(self) -> (TableEncoder, TableFile) {
        (self.encoder, self.file)
    }
}

impl TableEncoder {
    /// Takes rows in order, and returns the row groups that are full.
    ///
    /// # Errors
    /// When the batch has another schema.
    pub fn encode(&mut self, batch: RecordBatch) -> Result<Vec<EncodedRows>, StoreError> {
        self.pending_rows += batch.num_rows();
        self.pending.push(batch);
        let mut full = Vec::new();
        while self.pending_rows >= self.rows_per_row_group {
            full.push(self.encode_row_group(self.rows_per_row_group)?);
        }
        Ok(full)
    }

    /// Encodes the remaining rows, which do not fill a row group.
    ///
    /// # Errors
    /// When a batch had another schema.
    pub fn encode_rest(&mut self) -> Result<Option<EncodedRows>, StoreError> {
        if self.pending_rows == 0 {
            return Ok(None);
        }
        self.encode_row_group(self.pending_rows).map(Some)
    }

    /// Pages are cut per batch, so each row group goes to the encoder as one batch.
    fn encode_row_group(&mut self, rows: usize) -> Result<EncodedRows, StoreError> {
        let failed = || StoreError::parquet("encoding", &self.path);
        let pending = match self.pending.as_slice() {
            [one] => one.clone(),
            many => concat_batches(&self.schema, many)
                .map_err(|error| failed()(ParquetError::from(error)))?,
        };
        let columns = self.encode_columns(&pending.slice(0, rows)).map_err(failed())?;
        self.pending_rows -= rows;
        self.pending = match self.pending_rows {
            0 => Vec::new(),
            left => vec![pending.slice(rows, left)],
        };
        Ok(EncodedRows { columns })
    }

    fn encode_columns(&self, rows: &RecordBatch) -> Result<Vec<ArrowColumnChunk>, ParquetError> {
        if rows.schema_ref().fields() != self.schema.fields() {
            return Err(ParquetError::General(
                "the rows have other columns than the table".to_owned(),
            ));
        }
        // The index of the row group matters only to encrypted files.
        let writers = self.factory.create_column_writers(0)?;
        let columns = writers.into_par_iter().zip(&self.schema.fields()[..]).zip(rows.columns());
        columns
            .map(|((mut writer, field), values): ((ArrowColumnWriter, _), _)| {
                for leaf in compute_leaves(field, values)? {
                    writer.write(&leaf)?;
                }
                writer.close()
            })
            .collect()
    }
}

impl TableFile {
    /// Writes row groups in the order in which they were encoded.
    ///
    /// # Errors
    /// When the disk is full or fails.
    pub fn append(&mut self, rows: EncodedRows) -> Result<(), StoreError> {
        self.append_columns(rows.columns).map_err(StoreError::parquet("writing", &self.path))
    }

    fn append_columns(&mut self, columns: Vec<ArrowColumnChunk>) -> Result<(), ParquetError> {
        let mut row_group = self.writer.next_row_group()?;
        for column in columns {
            column.append_to_row_group(&mut row_group)?;
        }
        row_group.close()?;
        Ok(())
    }

    /// Publishes the file.
    ///
    /// # Errors
    /// When the disk is full or fails. Nothing lies under the path then.
    pub fn finish(self) -> Result<StoredObject, StoreError> {
        let object =
            self.writer.into_inner().map_err(StoreError::parquet("writing", &self.path))?;
        object.finish()
    }
}
