//! Objects without a row: what a worker published, or began to write, before it was killed.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use futures::TryStreamExt;
use object_store::ObjectStore;

use crate::database::sql;
use crate::{Store, StoreError};

impl Store {
    /// Deletes objects that no row names and unfinished files, both only when older than
    /// `older_than`: a younger one may be about to be committed. Returns how many.
    ///
    /// # Errors
    /// When the database or the listing of objects fails.
    pub async fn sweep_orphans(&self, older_than: Duration) -> Result<u64, StoreError> {
        let unfinished = self.delete_unfinished(older_than).await?;
        let orphans = self.orphans(older_than).await?;
        let count = orphans.len() as u64 + unfinished;
        self.objects().delete(orphans).await;
        Ok(count)
    }

    async fn orphans(&self, older_than: Duration) -> Result<Vec<String>, StoreError> {
        let Some(limit) = SystemTime::now().checked_sub(older_than) else { return Ok(Vec::new()) };
        let mut old: Vec<String> = self
            .objects()
            .local()
            .list(None)
            .try_filter(|object| std::future::ready(SystemTime::from(object.last_modified) < limit))
            .map_ok(|object| object.location.to_string())
            .try_collect()
            .await
            .map_err(StoreError::object("listing", "objects"))?;
        // Rows are read after the listing, so that what was committed in between is seen.
        const OPERATION: &str = "listing the objects that rows name";
        let named = sql!(self.database(), OPERATION, named_objects())?;
        let named: HashSet<String> = named.into_iter().collect();
        old.retain(|path| !named.contains(path));
        Ok(old)
    }

    /// object_store writes to `NAME#N` beside its destination, which it does not list.
    async fn delete_unfinished(&self, older_than: Duration) -> Result<u64, StoreError> {
        let root = self.objects().root().to_owned();
        let swept =
            tokio::task::spawn_blocking(move || delete_unfinished_below(&root, older_than)).await;
        swept.map_err(std::io::Error::other).flatten().map_err(|source| StoreError::ObjectFile {
            operation: "sweeping unfinished files",
            path: "objects".to_owned(),
            source,
        })
    }
}

fn delete_unfinished_below(root: &Path, older_than: Duration) -> std::io::Result<u64> {
    let mut deleted = 0;
    let mut folders: Vec<PathBuf> = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder)? {
            let entry = entry?;
            let metadata = entry.metadata()?;
            if metadata.is_dir() {
                folders.push(entry.path());
            } else if entry.file_name().to_string_lossy().contains('#')
                && metadata.modified()?.elapsed().is_ok_and(|age| age > older_than)
            {
                std::fs::remove_file(entry.path())?;
                deleted += 1;
            }
        }
    }
    Ok(deleted)
}
