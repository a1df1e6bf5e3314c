//! Leftovers: objects without a row, which a worker published before it was killed, and files that
//! it did not finish.

use std::collections::HashSet;
use std::path::PathBuf;
use std::time::Duration;

use crate::boxed;
use crate::objects::UnfinishedLeftover;
use crate::{Store, StoreError};

/// Leftovers of a store.
#[derive(Clone, Debug, Default)]
pub(crate) struct Leftovers {
    /// The paths and sizes of objects without a row.
    pub orphans: Vec<(String, u64)>,
    /// Files on this machine.
    pub unfinished: Vec<UnfinishedLeftover>,
}

impl Store {
    /// Finds leftovers that are older than `older_than`. Younger ones may be about to be committed.
    /// Only files whose names torqued makes are among them.
    ///
    /// # Errors
    /// [`StoreError::Displaced`] when the place is not that of this store any more. It also fails
    /// when the database or the listing of objects fails.
    pub(crate) async fn leftovers(&self, older_than: Duration) -> Result<Leftovers, StoreError> {
        // The place of another store would have only orphans.
        self.check_place_now().await?;
        let unfinished = self.objects().unfinished(older_than).await?;
        Ok(Leftovers { orphans: self.orphans(older_than).await?, unfinished })
    }

    /// Deletes leftovers. Returns how many unfinished files it deleted.
    pub(crate) async fn delete_leftovers(&self, leftovers: Leftovers) -> Result<u64, StoreError> {
        let Leftovers { orphans, unfinished } = leftovers;
        let unfinished: Vec<PathBuf> = unfinished.into_iter().map(|left| left.file).collect();
        let deleted = self.objects().delete_unfinished(unfinished).await?;
        self.objects().delete(orphans.into_iter().map(|(path, _)| path).collect()).await;
        Ok(deleted)
    }

    /// The paths and sizes of objects without a row.
    async fn orphans(&self, older_than: Duration) -> Result<Vec<(String, u64)>, StoreError> {
        const OPERATION: &str = "listing the objects that rows name";
        // The ages of objects are by the clock of the object store.
        let now = self.objects().now().await?;
        let Some(limit) = now.checked_sub(older_than) else { return Ok(Vec::new()) };
        let mut old = self.objects().older_than(limit).await?;
        // Rows are read after the listing, so objects that were committed in between are seen.
        let named = self.read(OPERATION).named_objects().await?;
        let named: HashSet<String> = named.into_iter().collect();
        old.retain(|(path, _)| !named.contains(path));
        Ok(old)
    }
}

/// Sweeps leftovers, again and again. Each is announced by one sweep and deleted by a later one, so
/// the first sweep of a store deletes nothing, and somebody can read the log in between.
#[derive(Debug)]
pub struct Sweeper {
    store: Store,
    announced: HashSet<String>,
}

/// The outcome of a sweep.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Swept {
    /// Number of deleted files, which an earlier sweep had announced.
    pub deleted: u64,
    /// The files that a later sweep deletes, which no earlier one had announced.
    pub announced: Vec<String>,
    /// Their size.
    pub bytes: u64,
}

impl Sweeper {
    /// A sweeper of this store. It has found nothing yet.
    pub fn new(store: Store) -> Self {
        Self { store, announced: HashSet::new() }
    }

    /// Deletes announced leftovers, and announces those that are new.
    ///
    /// # Errors
    /// [`StoreError::Displaced`] when the place is not that of this store any more. It also fails
    /// when the database or the listing of objects fails.
    #[boxed]
    pub async fn sweep(&mut self, older_than: Duration) -> Result<Swept, StoreError> {
        let mut known = self.store.leftovers(older_than).await?;
        let mut swept = Swept::default();
        let mut is_known = |name: String, size: u64| {
            let is_known = self.announced.contains(&name);
            if !is_known {
                swept.bytes += size;
                swept.announced.push(name);
            }
            is_known
        };
        known.orphans.retain(|(path, size)| is_known(path.clone(), *size));
        known.unfinished.retain(|left| is_known(left.file.display().to_string(), left.size));
        // A file that could not be deleted is announced again.
        self.announced = swept.announced.iter().cloned().collect();
        swept.deleted = known.orphans.len() as u64;
        swept.deleted += self.store.delete_leftovers(known).await?;
        Ok(swept)
    }
}
