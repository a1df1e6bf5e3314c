//! Objects without a row: what a worker published, or began to write, before it was killed.

use std::collections::HashSet;
use std::time::Duration;

use crate::boxed;
use crate::database::sql;
use crate::{Store, StoreError};

impl Store {
    /// Deletes objects that no row names and unfinished files, both only when older than
    /// `older_than`: a younger one may be about to be committed. Returns how many.
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

    /// The paths and sizes of such objects.
    pub(crate) async fn orphans(
        &self,
        older_than: Duration,
    ) -> Result<Vec<(String, u64)>, StoreError> {
        const OPERATION: &str = "listing the objects that rows name";
        // Their ages are by the clock of the store that they lie in.
        let now = self.objects().now().await?;
        let Some(limit) = now.checked_sub(older_than) else { return Ok(Vec::new()) };
        let mut old = self.objects().older_than(limit).await?;
        // Rows are read after the listing, so that what was committed in between is seen.
        let named = sql!(self.database(), OPERATION, named_objects())?;
        let named: HashSet<String> = named.into_iter().collect();
        old.retain(|(path, _)| !named.contains(path));
        Ok(old)
    }
}
