//! Reads a Parquet table, one row group at a time. Blocks.

use std::fs::File;
use std::path::Path;

use arrow_array::RecordBatch;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder,
};
use parquet::errors::ParquetError;

use crate::objects::file::PositionedFile;
use crate::{Store, StoreError, StoredObject};

/// An open Parquet table. Threads may share it.
#[derive(Clone, Debug)]
pub struct TableReader {
    file: PositionedFile,
    metadata: ArrowReaderMetadata,
    path: String,
}

impl Store {
    /// Opens a stored table after checking all its bytes against its digest.
    ///
    /// # Errors
    /// When the file cannot be read, or its bytes differ from those that were published.
    pub fn open_table(&self, object: &StoredObject) -> Result<TableReader, StoreError> {
        TableReader::new(self.objects().open_verified(object)?, object.path.clone())
    }

    /// Opens a stored table without checking its digest. The decoder may panic on damaged pages.
    ///
    /// # Errors
    /// When the file does not exist or its footer cannot be read.
    pub fn open_unchecked(&self, object: &StoredObject) -> Result<TableReader, StoreError> {
        TableReader::new(self.objects().open(&object.path)?, object.path.clone())
    }
}

impl TableReader {
    /// Opens any file.
    ///
    /// # Errors
    /// When it does not exist or its footer cannot be read.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let name = path.display().to_string();
        let file = File::open(path).map_err(StoreError::file("opening", &name))?;
        Self::new(file, name)
    }

    pub(crate) fn new(file: File, path: String) -> Result<Self, StoreError> {
        let file = PositionedFile::new(file).map_err(StoreError::file("opening", &path))?;
        let metadata = ArrowReaderMetadata::load(&file, ArrowReaderOptions::new())
            .map_err(StoreError::parquet("opening", &path))?;
        Ok(Self { file, metadata, path })
    }

    /// The path of the object.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Number of rows of the whole table.
    pub fn rows(&self) -> u64 {
        self.metadata.metadata().file_metadata().num_rows().unsigned_abs()
    }

    /// The number of rows of each row group.
    pub fn row_groups(&self) -> impl Iterator<Item = u64> {
        self.metadata.metadata().row_groups().iter().map(|group| group.num_rows().unsigned_abs())
    }

    /// Names of the columns, in order.
    pub fn columns(&self) -> Vec<&str> {
        self.metadata.schema().fields().iter().map(|field| field.name().as_str()).collect()
    }

    /// The value in the footer under `key`.
    pub fn footer(&self, key: &str) -> Option<&str> {
        let entries = self.metadata.metadata().file_metadata().key_value_metadata()?;
        entries.iter().find(|entry| entry.key == key)?.value.as_deref()
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
        self.read(row_group, columns).map_err(StoreError::parquet("reading", &self.path))
    }

    fn read(&self, row_group: usize, columns: &[&str]) -> Result<RecordBatch, ParquetError> {
        let Some(rows) = self.row_groups().nth(row_group) else {
            return Err(ParquetError::General(format!("it has no row group {row_group}")));
        };
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
}
