//! Deleting for good: what lay in the trash until its date, and objects without a row.
//!
//! Rows go first, objects after them. Whoever is killed in between leaves objects that no row names, which the next sweep
//! finds; no row ever names an object that was deleted.

use std::time::Duration;

use spec::Digest;
use wire::ItemKind;

use crate::boxed;
use crate::database::{Scope, sql};
use crate::{Item, JobId, Store, StoreError, Timestamp};

/// When something in the trash may be deleted for good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ripe {
    /// At the date that it got when it was deleted. The database's clock may have been set ahead by so much.
    AtItsDate { leap: Duration },
    /// When it was deleted so long ago.
    After(Duration),
}

/// Something that is deleted for good.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Garbage {
    pub kind: GarbageKind,
    /// Of its job, its run or its file.
    pub name: String,
    pub files: u64,
    pub bytes: u64,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GarbageKind {
    Item(Item),
    /// A run that a client of MLflow logged, by the name that clients have for it.
    TrackedRun(String),
    /// A file that was sent, when all jobs that read it are gone.
    Upload(Digest),
    /// Objects that no row names.
    Orphans,
}

/// The column that tells whether something is ripe, and the last moment at which it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limit {
    pub column: &'static str,
    pub moment: Timestamp,
}

/// Those that own others come after them.
const IN_ORDER: [ItemKind; 4] =
    [ItemKind::Checkpoint, ItemKind::Dataset, ItemKind::Run, ItemKind::Job];

const PURGING: &str = "purging the trash";

impl Store {
    /// What [`Store::collect_garbage`] would delete, in its order.
    ///
    /// # Errors
    /// When the database or the listing of objects fails.
    #[boxed]
    pub async fn garbage(
        &self,
        ripe: Ripe,
        orphaned: Duration,
    ) -> Result<Vec<Garbage>, StoreError> {
        let mut found = self.ripe_garbage(self.limit(ripe).await?).await?;
        let orphans = self.orphans(orphaned).await?;
        if !orphans.is_empty() {
            found.push(of_orphans(&orphans));
        }
        Ok(found)
    }

    /// Deletes for good what is ripe, and objects that are older than `orphaned` and named by no row. Returns it.
    ///
    /// # Errors
    /// When the database or the listing of objects fails. What was deleted until then stays so.
    #[boxed]
    pub async fn collect_garbage(
        &self,
        ripe: Ripe,
        orphaned: Duration,
    ) -> Result<Vec<Garbage>, StoreError> {
        let mut deleted = self.purge(ripe).await?;
        let orphans = self.orphans(orphaned).await?;
        if !orphans.is_empty() {
            deleted.push(of_orphans(&orphans));
            self.objects().delete(orphans.into_iter().map(|(path, _)| path).collect()).await;
        }
        Ok(deleted)
    }

    /// The same for what is in the trash alone.
    ///
    /// # Errors
    /// When the database fails. What was deleted until then stays so.
    #[boxed]
    pub async fn purge(&self, ripe: Ripe) -> Result<Vec<Garbage>, StoreError> {
        let limit = self.limit(ripe).await?;
        let mut deleted = Vec::new();
        for garbage in self.ripe_garbage(limit).await? {
            let files = match &garbage.kind {
                GarbageKind::Item(item) => self.purge_item(*item, limit).await?,
                GarbageKind::TrackedRun(run) => self.purge_tracked_run(run, limit).await?,
                // These follow from the rest.
                GarbageKind::Upload(_) | GarbageKind::Orphans => continue,
            };
            // Unless somebody restored or purged it meanwhile.
            if let Some(files) = files {
                deleted.push(Garbage {
                    files: files.len() as u64,
                    bytes: files.iter().map(|(_, size)| size).sum(),
                    ..garbage
                });
            }
        }
        deleted.extend(self.purge_remains(limit).await?);
        Ok(deleted)
    }

    async fn limit(&self, ripe: Ripe) -> Result<Limit, StoreError> {
        let (column, before) = match ripe {
            Ripe::AtItsDate { leap } => ("purge_at", leap),
            Ripe::After(age) => ("deleted_at", age),
        };
        let before = i64::try_from(before.as_millis()).unwrap_or(i64::MAX);
        let moment = self.now().await?.milliseconds().saturating_sub(before);
        Ok(Limit { column, moment: Timestamp::from_milliseconds(moment) })
    }

    async fn ripe_garbage(&self, limit: Limit) -> Result<Vec<Garbage>, StoreError> {
        let mut found = Vec::new();
        for kind in IN_ORDER {
            found.extend(sql!(self.database(), PURGING, ripe_items(kind, limit))?);
        }
        let job = |it: &Garbage| match it.kind {
            GarbageKind::Item(Item { kind: ItemKind::Job, id }) => Some(JobId(id)),
            _ => None,
        };
        let jobs: Vec<JobId> = found.iter().filter_map(job).collect();
        found.extend(sql!(self.database(), PURGING, ripe_tracked_runs(limit))?);
        found.extend(sql!(self.database(), PURGING, unread_uploads(&jobs))?);
        Ok(found)
    }

    /// The objects that it had, by path and size; `None` when it is not ripe any more.
    async fn purge_item(
        &self,
        item: Item,
        limit: Limit,
    ) -> Result<Option<Vec<(String, u64)>>, StoreError> {
        let mut tx = self.begin(Scope::Rows, PURGING).await?;
        if !sql!(&mut tx, mark_purged(item, limit))? {
            return Ok(None);
        }
        if item.kind == ItemKind::Job {
            sql!(&mut tx, keep_count_of_attempts(JobId(item.id)))?;
        }
        let files = sql!(&mut tx, delete_details(item))?;
        tx.commit().await?;
        self.delete_objects(&files).await;
        Ok(Some(files))
    }

    async fn purge_tracked_run(
        &self,
        identifier: &str,
        limit: Limit,
    ) -> Result<Option<Vec<(String, u64)>>, StoreError> {
        let mut tx = self.begin(Scope::Rows, PURGING).await?;
        let Some(run) = sql!(&mut tx, ripe_tracked_run(identifier, limit))? else {
            return Ok(None);
        };
        let files = sql!(&mut tx, delete_tracked_run(run))?;
        tx.commit().await?;
        self.delete_objects(&files).await;
        Ok(Some(files))
    }

    /// What nothing needs any more once the rest is purged: files that were sent, rows of jobs that no other job refers to,
    /// experiments without runs.
    async fn purge_remains(&self, limit: Limit) -> Result<Vec<Garbage>, StoreError> {
        // A submission may be about to refer to one of them.
        let mut tx = self.begin(Scope::Queue, PURGING).await?;
        let uploads = sql!(&mut tx, delete_unread_uploads())?;
        while sql!(&mut tx, delete_purged_jobs())? > 0 {}
        sql!(&mut tx, delete_empty_experiments(limit))?;
        tx.commit().await?;
        let garbage = |(object, name): &(crate::StoredObject, String)| Garbage {
            kind: GarbageKind::Upload(object.sha256),
            name: name.clone(),
            files: 1,
            bytes: object.size,
        };
        let deleted = uploads.iter().map(garbage).collect();
        self.objects().delete(uploads.into_iter().map(|(object, _)| object.path).collect()).await;
        Ok(deleted)
    }

    async fn delete_objects(&self, files: &[(String, u64)]) {
        self.objects().delete(files.iter().map(|(path, _)| path.clone()).collect()).await;
    }
}

fn of_orphans(orphans: &[(String, u64)]) -> Garbage {
    Garbage {
        kind: GarbageKind::Orphans,
        name: "files that nothing refers to".to_owned(),
        files: orphans.len() as u64,
        bytes: orphans.iter().map(|(_, size)| size).sum(),
    }
}
