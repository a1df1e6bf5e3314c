//! Objects found without a row, for rebuilding a lost database.

use arrow_array::Int32Array;
use arrow_array::cast::AsArray as _;
use arrow_array::types::Int32Type;
use futures::TryStreamExt as _;

use crate::database::Scope;
use crate::objects::path::is_mark;
use crate::{JobId, RunId, Store, StoreError, StoredObject, TableReader, boxed};

const OPERATION: &str = "making a database again";

/// A table that was found.
pub struct FoundTable {
    /// The bytes that were found.
    pub object: StoredObject,
    /// A reader of the file.
    pub reader: TableReader,
}

impl Store {
    /// The paths of all objects but the store's own marks, sorted.
    ///
    /// # Errors
    /// When they cannot be listed.
    #[boxed]
    pub async fn list_objects(&self) -> Result<Vec<String>, StoreError> {
        let listed =
            self.objects().remote().list(None).map_ok(|object| object.location.to_string());
        let listed = listed.try_collect::<Vec<String>>().await;
        let mut paths = listed.map_err(StoreError::object("listing", "objects"))?;
        paths.retain(|path| !is_mark(path));
        paths.sort_unstable();
        Ok(paths)
    }

    /// Reads an object to learn its size and digest.
    ///
    /// # Errors
    /// When it cannot be read.
    #[boxed]
    pub async fn find_object(&self, path: &str) -> Result<StoredObject, StoreError> {
        let (store, owned) = (self.clone(), path.to_owned());
        let measured = tokio::task::spawn_blocking(move || store.objects().measure(&owned)).await;
        measured.map_err(|error| broken(path, error))?
    }

    /// Reads a table to learn its size, its digest and its footer.
    ///
    /// # Errors
    /// When it cannot be read or is no table.
    #[boxed]
    pub async fn find_table(&self, path: &str) -> Result<FoundTable, StoreError> {
        let (store, owned) = (self.clone(), path.to_owned());
        let read = move || {
            let object = store.objects().measure(&owned)?;
            let reader = store.open_unchecked(&object)?;
            Ok(FoundTable { object, reader })
        };
        // A decoder may panic on a damaged file.
        tokio::task::spawn_blocking(read).await.map_err(|error| broken(path, error))?
    }

    /// Raises the next job id and the next run id above these.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn skip_numbers(&self, job: JobId, run: RunId) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Queue, OPERATION).await?;
        for (table, last) in [("job", job.0), ("run", run.0)] {
            if tx.last_number(table).await?.unwrap_or(0) < last {
                tx.set_last_number(table, last).await?;
            }
        }
        tx.commit().await
    }
}

impl FoundTable {
    /// The sum of a column of 32-bit integers.
    ///
    /// # Errors
    /// When there is no such column, or it cannot be read.
    #[boxed]
    pub async fn sum(&self, column: &str) -> Result<u64, StoreError> {
        let (reader, name) = (self.reader.clone(), column.to_owned());
        let read = move || {
            let mut sum = 0_u64;
            for row_group in 0..reader.row_groups().count() {
                let rows = reader.read_row_group(row_group, &[name.as_str()])?;
                let values: Option<&Int32Array> = rows.column(0).as_primitive_opt::<Int32Type>();
                let values = values.into_iter().flat_map(|values| values.values().iter());
                sum += values.map(|value| u64::try_from(*value).unwrap_or_default()).sum::<u64>();
            }
            Ok(sum)
        };
        let path = &self.object.path;
        tokio::task::spawn_blocking(read).await.map_err(|error| broken(path, error))?
    }
}

fn broken(path: &str, error: tokio::task::JoinError) -> StoreError {
    StoreError::file("reading", path)(std::io::Error::other(error))
}
