//! The trash: what was deleted and can still be restored.
//!
//! A job owns the dataset and the run that it leaves, a run its checkpoints, and a pipeline the members that were made for it
//! alone. What is owned goes into the trash and comes back together with its owner.

use std::fmt;
use std::time::Duration;

use spec::Digest;
use wire::{ItemKind, JobState};

use crate::boxed;
use crate::database::{Scope, Transaction, sql};
use crate::dependents::{self, Dependent};
use crate::rules::deletion::{Obstacle, obstacle};
use crate::{CheckpointId, DatasetId, JobId, RunId, Store, StoreError, Timestamp};

/// Something that can be deleted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Item {
    pub kind: ItemKind,
    pub id: i64,
}

/// That something was deleted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deletion {
    pub deleted_at: Timestamp,
    /// It can be restored until then at least.
    pub purge_at: Timestamp,
    /// When its bytes and details were deleted for good.
    pub purged_at: Option<Timestamp>,
    /// `None` when somebody asked for it.
    pub reason: Option<String>,
}

/// Whether jobs that have ended and depend on something keep it from being deleted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Respect {
    All,
    /// Only jobs that have not ended do.
    Open,
}

/// How something is to be deleted.
#[derive(Clone, Copy, Debug)]
pub struct DeletionOrder<'a> {
    pub respect: Respect,
    /// How long it can be restored.
    pub keep: Duration,
    /// `None` when somebody asks for it.
    pub reason: Option<&'a str>,
}

/// The things that a deletion moved into the trash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deleted {
    pub item: Item,
    /// What it owns.
    pub along: Vec<Item>,
    pub deleted_at: Timestamp,
    pub purge_at: Timestamp,
}

/// Something in the trash that no other thing took along.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trashed {
    pub item: Item,
    /// Of its job.
    pub name: String,
    /// Of its files, and of those that went with it.
    pub bytes: u64,
    pub deletion: Deletion,
}

/// A place in the trash, which is sorted by these, the last first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrashPlace {
    pub deleted_at: Timestamp,
    pub item: Item,
}

/// The row of something that can be deleted.
#[derive(Clone, Debug)]
pub(crate) struct ItemRow {
    pub item: Item,
    /// That made it, or that it is.
    pub job: JobId,
    pub job_state: JobState,
    pub digest: Digest,
    pub deletion: Option<Deletion>,
    /// When its owner was deleted.
    pub owner_deleted_at: Option<Timestamp>,
}

/// The extent of a deletion.
pub(crate) struct Reach {
    /// The job that made the item; of a job, it and the members that it owns.
    pub jobs: Vec<JobId>,
    pub digests: Vec<Digest>,
    /// Whether the jobs themselves go, and not only what they left.
    pub whole: bool,
}

const DELETING: &str = "deleting something";

impl Item {
    pub const fn new(kind: ItemKind, id: i64) -> Self {
        Self { kind, id }
    }
}

impl From<JobId> for Item {
    fn from(JobId(id): JobId) -> Self {
        Self::new(ItemKind::Job, id)
    }
}

impl From<RunId> for Item {
    fn from(RunId(id): RunId) -> Self {
        Self::new(ItemKind::Run, id)
    }
}

impl From<DatasetId> for Item {
    fn from(DatasetId(id): DatasetId) -> Self {
        Self::new(ItemKind::Dataset, id)
    }
}

impl From<CheckpointId> for Item {
    fn from(CheckpointId(id): CheckpointId) -> Self {
        Self::new(ItemKind::Checkpoint, id)
    }
}

impl fmt::Display for Item {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.kind, self.id)
    }
}

impl Store {
    /// Moves something into the trash, with all that it owns.
    ///
    /// # Errors
    /// [`StoreError::NotEnded`] while its job goes on; [`StoreError::Needed`] when jobs depend on it; when there is no
    /// such thing, or it was deleted before.
    #[boxed]
    pub async fn delete(
        &self,
        item: Item,
        order: &DeletionOrder<'_>,
    ) -> Result<Deleted, StoreError> {
        // No job is submitted, and none ends, until this has taken effect.
        let mut tx = self.begin(Scope::Queue, DELETING).await?;
        let row = present(&mut tx, item).await?;
        let reach = reach(&mut tx, &row).await?;
        let found = dependents::of(&mut tx, &reach).await?;
        match obstacle(row.job_state, order.respect, &found) {
            None => {}
            Some(Obstacle::NotEnded) => {
                return Err(StoreError::NotEnded { item, job: row.job, state: row.job_state });
            }
            Some(Obstacle::Needed) => return Err(StoreError::Needed { item, by: found }),
        }
        let deleted_at = sql!(&mut tx, present())?;
        let keep = i64::try_from(order.keep.as_millis()).unwrap_or(i64::MAX);
        let milliseconds = deleted_at.milliseconds().saturating_add(keep);
        let purge_at = Timestamp::from_milliseconds(milliseconds);
        let reason = order.reason.map(str::to_owned);
        let deletion = Deletion { deleted_at, purge_at, purged_at: None, reason };
        let mut along = Vec::new();
        for (kind, column, ids) in owned(item, &reach) {
            along.extend(sql!(&mut tx, mark_deleted(kind, column, &ids, &deletion))?);
        }
        along.retain(|other| *other != item);
        tx.commit().await?;
        Ok(Deleted { item, along, deleted_at, purge_at })
    }

    /// Takes something out of the trash, with what went there with it, which is returned.
    ///
    /// # Errors
    /// [`StoreError::Purged`] when it is too late, [`StoreError::OwnerDeleted`] when its owner is in the trash, too;
    /// [`StoreError::NotDeleted`] when it was not deleted.
    #[boxed]
    pub async fn restore(&self, item: Item) -> Result<Vec<Item>, StoreError> {
        let mut tx = self.begin(Scope::Queue, "restoring something").await?;
        let row = known(&mut tx, item).await?;
        let Some(deletion) = &row.deletion else { return Err(StoreError::NotDeleted { item }) };
        if let Some(purged_at) = deletion.purged_at {
            return Err(StoreError::Purged { item, purged_at });
        }
        if row.owner_deleted_at.is_some() {
            return Err(StoreError::OwnerDeleted { item, job: row.job });
        }
        let jobs = match item.kind {
            ItemKind::Job => sql!(&mut tx, members_deleted_with(row.job, deletion.deleted_at))?,
            _ => Vec::new(),
        };
        let jobs = std::iter::once(row.job).chain(jobs).collect();
        let reach = Reach { jobs, digests: Vec::new(), whole: item.kind == ItemKind::Job };
        let mut restored = Vec::new();
        for (kind, column, ids) in owned(item, &reach) {
            restored.extend(sql!(&mut tx, mark_restored(kind, column, &ids, deletion.deleted_at))?);
        }
        // The statements above wait for a purge under way, and leave what it purged as it is.
        let Some(place) = restored.iter().position(|other| *other == item) else {
            let purged_at = sql!(&mut tx, present())?;
            return Err(StoreError::Purged { item, purged_at });
        };
        restored.remove(place);
        tx.commit().await?;
        Ok(restored)
    }

    /// What a deletion of `item` would take along, and the jobs that depend on it.
    ///
    /// # Errors
    /// When there is no such thing, or it was deleted before.
    #[boxed]
    pub async fn dependents(&self, item: Item) -> Result<(Vec<Item>, Vec<Dependent>), StoreError> {
        let mut tx = self.begin_snapshot("looking for what depends on something").await?;
        let row = present(&mut tx, item).await?;
        let reach = reach(&mut tx, &row).await?;
        let found = dependents::of(&mut tx, &reach).await?;
        let mut along = Vec::new();
        for (kind, column, ids) in owned(item, &reach) {
            along.extend(sql!(&mut tx, items_not_deleted(kind, column, &ids))?);
        }
        along.retain(|other| *other != item);
        tx.roll_back().await?;
        Ok((along, found))
    }

    /// The size of the files of `items`, in bytes.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn size_of(&self, items: &[Item]) -> Result<u64, StoreError> {
        let mut bytes = 0;
        for kind in ItemKind::ALL {
            let of_kind = items.iter().filter(|item| item.kind == kind);
            let ids: Vec<i64> = of_kind.map(|item| item.id).collect();
            if !ids.is_empty() {
                bytes += sql!(self.database(), "adding up files", size_of(kind, &ids))?;
            }
        }
        Ok(bytes)
    }

    /// What is in the trash and was not taken along by something else, what was deleted last first, from the first after
    /// `after` on.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn trash(
        &self,
        after: Option<TrashPlace>,
        limit: u32,
    ) -> Result<Vec<Trashed>, StoreError> {
        sql!(self.database(), "reading the trash", trash(after, limit))
    }
}

/// The rows that change together: kind, the column that names them, and its values.
fn owned(item: Item, reach: &Reach) -> Vec<(ItemKind, &'static str, Vec<i64>)> {
    let jobs = || reach.jobs.iter().map(|job| job.0).collect();
    match item.kind {
        ItemKind::Job => vec![
            (ItemKind::Job, "id", jobs()),
            (ItemKind::Run, "job", jobs()),
            (ItemKind::Dataset, "job", jobs()),
            (ItemKind::Checkpoint, "job", jobs()),
        ],
        ItemKind::Run => {
            vec![(ItemKind::Run, "id", vec![item.id]), (ItemKind::Checkpoint, "run", vec![item.id])]
        }
        kind => vec![(kind, "id", vec![item.id])],
    }
}

async fn reach(tx: &mut Transaction, row: &ItemRow) -> Result<Reach, StoreError> {
    let whole = row.item.kind == ItemKind::Job;
    let (mut jobs, mut digests) = (vec![row.job], vec![row.digest]);
    if whole {
        for (member, digest) in sql!(tx, owned_members(row.job))? {
            jobs.push(member);
            digests.push(digest);
        }
    }
    Ok(Reach { jobs, digests, whole })
}

async fn known(tx: &mut Transaction, item: Item) -> Result<ItemRow, StoreError> {
    sql!(tx, item(item))?
        .ok_or_else(|| StoreError::not_found(item.kind.as_str(), item.id.to_string()))
}

/// The row of something that was not deleted.
async fn present(tx: &mut Transaction, item: Item) -> Result<ItemRow, StoreError> {
    let row = known(tx, item).await?;
    refuse_deleted(item, row.deletion.as_ref())?;
    Ok(row)
}

/// # Errors
/// When it was deleted.
pub(crate) fn refuse_deleted(
    item: impl Into<Item>,
    deletion: Option<&Deletion>,
) -> Result<(), StoreError> {
    let item = item.into();
    match deletion {
        None => Ok(()),
        Some(Deletion { purged_at: Some(purged_at), .. }) => {
            Err(StoreError::Purged { item, purged_at: *purged_at })
        }
        Some(Deletion { deleted_at, purge_at, .. }) => {
            let (deleted_at, purge_at) = (*deleted_at, *purge_at);
            Err(StoreError::InTrash { item, deleted_at, purge_at })
        }
    }
}
