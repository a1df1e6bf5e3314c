//! Orphans: objects without a row. A worker published them, or began to write them, before it was
//! killed.

use std::collections::HashSet;
use std::time::Duration;

use crate::boxed;
use crate::database::sql;
use crate::{Store, StoreError};

impl Store {
    /// Deletes objects without a row and unfinished files, if they are older than `older_than`.
    /// Younger ones may be about to be committed. Returns how many it deleted.
    ///
    /// # Errors
    /// When the database or the listing of objects fails.
    #[boxed]
    pub async fn sweep_orphans(&self, older_than: Duration) -> Result<u64, StoreError> {
        let unfinished = self.objects().delete_unfinished(older_than).await?;
        let orphans = self.orphans(older_than).await?;
        let count = orphans.len() as u64 + unfinished;
        self.objects().delete(orphans.into_iter().map(|(path, _)| path).collect()).await;
        Ok(count)
    }

    /// The paths and sizes of these objects.
    pub(crate) async fn orphans(
        &self,
        older_than: Duration,
    ) -> Result<Vec<(String, u64)>, StoreError> {
        const OPERATION: &str = "listing the objects that rows name";
        // The ages of objects are by the clock of the object store.
        let now = self.objects().now().await?;
        let Some(limit) = now.checked_sub(older_than) else { return Ok(Vec::new()) };
        let mut old = self.objects().older_than(limit).await?;
        // Rows are read after the listing, so objects that were committed in between are seen.
        let named = sql!(self.database(), OPERATION, named_objects())?;
        let named: HashSet<String> = named.into_iter().collect();
        old.retain(|(path, _)| !named.contains(path));
        Ok(old)
    }
}
