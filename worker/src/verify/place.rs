use std::path::Path;

use store::{Store, StoreError, StoredObject, TableReader};

/// Where the files to verify lie.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Place<'a> {
    Store(&'a Store),
    Folder(&'a Path),
}

impl Place<'_> {
    /// Size and SHA-256 of a file, as they are now.
    pub fn measure(&self, path: &str) -> Result<StoredObject, StoreError> {
        match self {
            Self::Store(store) => store.measure_object(path),
            Self::Folder(folder) => store::measure_file(folder, path),
        }
    }

    /// Opens a file without a look at its digest: the decoder may panic on damaged pages.
    pub fn open(&self, object: &StoredObject) -> Result<TableReader, StoreError> {
        match self {
            Self::Store(store) => store.open_unchecked(object),
            Self::Folder(folder) => TableReader::open(&folder.join(&object.path)),
        }
    }
}
