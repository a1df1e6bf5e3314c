use std::path::Path;

use store::{Store, StoreError, StoredObject, TableReader};

/// The place of the files to verify.
#[derive(Clone, Copy, Debug)]
pub(crate) enum FileLocation<'a> {
    Store(&'a Store),
    Folder(&'a Path),
}

impl FileLocation<'_> {
    /// Size and SHA-256 of a file's present bytes.
    pub fn measure(&self, path: &str) -> Result<StoredObject, StoreError> {
        match self {
            Self::Store(store) => store.measure_object(path),
            Self::Folder(folder) => store::measure_file(folder, path),
        }
    }

    /// Opens a file without checking its digest. The decoder may panic on damaged pages.
    pub fn open(&self, object: &StoredObject) -> Result<TableReader, StoreError> {
        match self {
            Self::Store(store) => store.open_unchecked(object),
            Self::Folder(folder) => TableReader::open(&folder.join(&object.path)),
        }
    }
}
