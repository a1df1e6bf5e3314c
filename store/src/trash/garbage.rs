//! Permanent deletion of items whose time in the trash is over, and of objects without a row.
//!
//! Rows are deleted first, and their objects afterwards. A process that is killed in between leaves
//! objects without a row, and the next sweep finds them. No row ever names a deleted object.

use std::time::Duration;

use spec::Digest;
use wire::ItemKind;

use crate::boxed;
use crate::database::{Scope, sql};
use crate::trash::leftovers::Leftovers;
use crate::{Item, JobId, Store, StoreError, Timestamp};

/// When an item in the trash may be deleted permanently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ripe {
    /// At the date that was set when it was deleted. The database's clock may be ahead by `leap`.
    AtItsDate { leap: Duration },
    /// When it was deleted at least this long ago.
    After(Duration),
}

/// Something that is deleted permanently.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Garbage {
    pub kind: GarbageKind,
    /// The name of its job, its run or its file.
    pub name: String,
    pub files: u64,
    pub bytes: u64,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GarbageKind {
    Item(Item),
    /// A run logged by an MLflow client, under the name that clients use.
    TrackedRun(String),
    /// An uploaded file that no remaining job reads.
    Upload(Digest),
    /// Objects without a row.
    Orphans,
    /// Files on this machine that killed workers did not finish.
    Unfinished,
}

/// The column that tells whether an item is ripe, and the latest moment at which it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limit {
    pub column: &'static str,
    pub moment: Timestamp,
}

/// The order of deletion: owners come after the things they own.
const IN_ORDER: [ItemKind; 4] =
    [ItemKind::Checkpoint, ItemKind::Dataset, ItemKind::Run, ItemKind::Job];

const PURGING: &str = "purging the trash";

impl Store {
    /// The things that [`Store::collect_garbage`] would delete, in the order of deletion.
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
        found.extend(of_leftovers(&self.leftovers(orphaned).await?));
        Ok(found)
    }

    /// Permanently deletes ripe items, objects without a row and unfinished files. The latter two
    /// are older than `orphaned`. Returns them.
    ///
    /// # Errors
    /// When the database or the listing of objects fails. Things deleted before the error stay
    /// deleted.
    #[boxed]
    pub async fn collect_garbage(
        &self,
        ripe: Ripe,
        orphaned: Duration,
    ) -> Result<Vec<Garbage>, StoreError> {
        let mut deleted = self.purge(ripe).await?;
        let leftovers = self.leftovers(orphaned).await?;
        deleted.extend(of_leftovers(&leftovers));
        self.delete_leftovers(leftovers).await?;
        Ok(deleted)
    }

    /// Permanently deletes ripe items of the trash, and nothing else.
    ///
    /// # Errors
    /// When the database fails. Things deleted before the error stay deleted.
    #[boxed]
    pub async fn purge(&self, ripe: Ripe) -> Result<Vec<Garbage>, StoreError> {
        // Rows would be deleted whose files are elsewhere.
        self.check_place_now().await?;
        let limit = self.limit(ripe).await?;
        let mut deleted = Vec::new();
        for garbage in self.ripe_garbage(limit).await? {
            let files = match &garbage.kind {
                GarbageKind::Item(item) => self.purge_item(*item, limit).await?,
                GarbageKind::TrackedRun(run) => self.purge_tracked_run(run, limit).await?,
                // They are deleted as a consequence of the others.
                GarbageKind::Upload(_) | GarbageKind::Orphans | GarbageKind::Unfinished => continue,
            };
            // `None` if somebody restored or purged it meanwhile.
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
        let job = |garbage: &Garbage| match garbage.kind {
            GarbageKind::Item(Item { kind: ItemKind::Job, id }) => Some(JobId(id)),
            _ => None,
        };
        let jobs: Vec<JobId> = found.iter().filter_map(job).collect();
        found.extend(sql!(self.database(), PURGING, ripe_tracked_runs(limit))?);
        found.extend(sql!(self.database(), PURGING, unread_uploads(&jobs))?);
        Ok(found)
    }

    /// The item's objects by path and size; `None` if it is no longer ripe.
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

    /// Deletes what the purge leaves unused: uploaded files, rows of jobs that no other job refers
    /// to, experiments without runs.
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

fn of_leftovers(leftovers: &Leftovers) -> Vec<Garbage> {
    let Leftovers { orphans, unfinished } = leftovers;
    let garbage = |kind, name: &str, sizes: Vec<u64>| Garbage {
        kind,
        name: name.to_owned(),
        files: sizes.len() as u64,
        bytes: sizes.iter().sum(),
    };
    let orphans = orphans.iter().map(|(_, size)| *size).collect();
    let unfinished = unfinished.iter().map(|left| left.size).collect();
    let all = [
        garbage(GarbageKind::Orphans, "files that nothing refers to", orphans),
        garbage(GarbageKind::Unfinished, "files that were never finished", unfinished),
    ];
    all.into_iter().filter(|garbage| garbage.files > 0).collect()
}
