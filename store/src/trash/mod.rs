//! The trash: deleted items that can still be restored.
//!
//! A job owns the dataset and the run that it leaves. A run owns its checkpoints. A pipeline owns
//! the members that were made for it alone. Owned items are deleted and restored together with
//! their owner.
//!
//! A deletion writes its date into the rows that it covers. It has the queue's scope, as a
//! submission has, so each sees what the other did. The table `job_input` says which jobs read a
//! digest. Lists, references and reuse pass over deleted rows.
//!
//! A purge deletes the rows of other tables that belong to a row, marks it, and then deletes the
//! objects. It keeps the number of attempts. The marked row stays, so its job does not stand in for
//! another. A job's row also stays while another job refers to it, because digests get their
//! meaning there.

pub(crate) mod dependents;
pub(crate) mod found_objects;
pub(crate) mod garbage;
pub(crate) mod inventory;
pub(crate) mod leftovers;
mod names;
pub(crate) mod retention;
pub(crate) mod rules;
pub(crate) mod statements;
mod unused_uploads;

use std::time::Duration;

use spec::Digest;
use wire::ItemKind;

use crate::boxed;
use crate::database::query::{Row, sql};
use crate::database::rows::deletion;
use crate::database::{Scope, Transaction};
use crate::trash::names::{given_to_result, name_of};
use crate::trash::rules::{Dependent, Item, Obstacle, Respect, obstacle};
use crate::trash::statements::trash::ItemRow;
use crate::{JobId, Store, StoreError, Timestamp};

/// The record of a deletion.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deletion {
    /// When it was moved to the trash.
    pub deleted_at: Timestamp,
    /// It can be restored until this moment at least.
    pub purge_at: Timestamp,
    /// The moment at which its bytes and details were deleted permanently.
    pub purged_at: Option<Timestamp>,
    /// The reason; `None` if somebody asked for it.
    pub reason: Option<String>,
}

/// How an item is to be deleted.
#[derive(Clone, Copy, Debug)]
pub struct DeletionOrder<'a> {
    /// Which jobs that depend on the item prevent its deletion.
    pub respect: Respect,
    /// How long it can be restored.
    pub keep: Duration,
    /// The reason; `None` if somebody asks for it.
    pub reason: Option<&'a str>,
}

/// The items that a deletion moved into the trash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deleted {
    /// The item that was asked for.
    pub item: Item,
    /// The items that it owns.
    pub along: Vec<Item>,
    /// When it was moved to the trash.
    pub deleted_at: Timestamp,
    /// When it will be deleted for good.
    pub purge_at: Timestamp,
}

/// An item in the trash that was not deleted together with its owner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trashed {
    /// The item in the trash.
    pub item: Item,
    /// The name by which people know it.
    pub name: String,
    /// The name that users gave the result of a job, which was deleted with it.
    pub result_name: Option<String>,
    /// Size of its files and of the files of items that were deleted with it.
    pub bytes: u64,
    /// When it was deleted, and why.
    pub deletion: Deletion,
}

/// A position in the trash, which is sorted by these fields, latest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrashPlace {
    /// When the last item before the page was deleted.
    pub deleted_at: Timestamp,
    /// That item, which decides between items of the same moment.
    pub item: Item,
}

/// The extent of a deletion.
pub(crate) struct Reach {
    /// The job that made the item. For a job, it and the members that it owns.
    pub jobs: Vec<JobId>,
    pub digests: Vec<Digest>,
    /// Whether the jobs themselves are deleted, and not only their results.
    pub whole: bool,
}

const DELETING: &str = "deleting something";

/// The items in the trash, without those that were deleted together with their owner. The size
/// covers their own files and the files of items that were deleted with them.
fn trash() -> String {
    let name = |kind| name_of(kind, "job");
    let given_to_result = given_to_result("job");
    let [job, run, dataset, checkpoint] =
        [ItemKind::Job, ItemKind::Run, ItemKind::Dataset, ItemKind::Checkpoint].map(name);
    format!(
        "SELECT * FROM (\
         SELECT 'job' AS kind, job.id, {job} AS name, {given_to_result} AS result_name, job.deleted_at, job.purge_at, job.purged_at, job.deletion_reason, \
             (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM dataset \
                  JOIN shard_file AS file ON file.dataset = dataset.id WHERE dataset.job = job.id) \
             + (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM run \
                  JOIN artifact AS file ON file.run = run.id WHERE run.job = job.id) \
             + (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM checkpoint \
                  JOIN checkpoint_file AS file ON file.checkpoint = checkpoint.id WHERE checkpoint.job = job.id) AS bytes \
         FROM job WHERE job.deleted_at IS NOT NULL AND job.purged_at IS NULL \
         AND NOT EXISTS (SELECT 1 FROM pipeline_member AS member JOIN job AS pipeline ON pipeline.id = member.pipeline \
             WHERE member.job = job.id AND pipeline.deleted_at = job.deleted_at) \
         UNION ALL SELECT 'run', run.id, {run}, NULL, run.deleted_at, run.purge_at, run.purged_at, run.deletion_reason, \
             (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM artifact AS file WHERE file.run = run.id) \
             + (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM checkpoint \
                  JOIN checkpoint_file AS file ON file.checkpoint = checkpoint.id WHERE checkpoint.run = run.id) \
         FROM run JOIN job ON job.id = run.job WHERE run.deleted_at IS NOT NULL AND run.purged_at IS NULL \
         AND (job.deleted_at IS NULL OR job.deleted_at <> run.deleted_at) \
         UNION ALL SELECT 'dataset', dataset.id, {dataset}, NULL, dataset.deleted_at, dataset.purge_at, dataset.purged_at, \
             dataset.deletion_reason, \
             (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM shard_file AS file WHERE file.dataset = dataset.id) \
         FROM dataset JOIN job ON job.id = dataset.job WHERE dataset.deleted_at IS NOT NULL AND dataset.purged_at IS NULL \
         AND (job.deleted_at IS NULL OR job.deleted_at <> dataset.deleted_at) \
         UNION ALL SELECT 'checkpoint', checkpoint.id, {checkpoint}, NULL, checkpoint.deleted_at, checkpoint.purge_at, \
             checkpoint.purged_at, checkpoint.deletion_reason, \
             (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM checkpoint_file AS file \
              WHERE file.checkpoint = checkpoint.id) \
         FROM checkpoint JOIN job ON job.id = checkpoint.job JOIN run ON run.id = checkpoint.run \
         WHERE checkpoint.deleted_at IS NOT NULL AND checkpoint.purged_at IS NULL \
         AND (run.deleted_at IS NULL OR run.deleted_at <> checkpoint.deleted_at)) AS trash"
    )
}

impl Store {
    /// Moves an item into the trash, with everything that it owns.
    ///
    /// # Errors
    /// [`StoreError::NotEnded`] while its job has not ended. [`StoreError::Needed`] when jobs
    /// depend on it. It also fails when there is no such item, or it was deleted before.
    #[boxed]
    pub async fn delete(
        &self,
        item: Item,
        order: &DeletionOrder<'_>,
    ) -> Result<Deleted, StoreError> {
        // No job is submitted and none ends until this has taken effect.
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
        let deleted_at = tx.present().await?;
        let keep = i64::try_from(order.keep.as_millis()).unwrap_or(i64::MAX);
        let milliseconds = deleted_at.milliseconds().saturating_add(keep);
        let purge_at = Timestamp::from_milliseconds(milliseconds);
        let reason = order.reason.map(str::to_owned);
        let deletion = Deletion { deleted_at, purge_at, purged_at: None, reason };
        let mut along = Vec::new();
        for (kind, column, ids) in owned(item, &reach) {
            along.extend(tx.mark_deleted(kind, column, &ids, &deletion).await?);
        }
        along.retain(|other| *other != item);
        tx.commit().await?;
        Ok(Deleted { item, along, deleted_at, purge_at })
    }

    /// Restores an item, with everything that was deleted together with it. Returns the restored
    /// items.
    ///
    /// # Errors
    /// [`StoreError::Purged`] when it is too late. [`StoreError::OwnerDeleted`] when its owner is
    /// in the trash too. [`StoreError::NotDeleted`] when it was not deleted.
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
            ItemKind::Job => tx.members_deleted_with(row.job, deletion.deleted_at).await?,
            _ => Vec::new(),
        };
        let jobs = std::iter::once(row.job).chain(jobs).collect();
        let reach = Reach { jobs, digests: Vec::new(), whole: item.kind == ItemKind::Job };
        let mut restored = Vec::new();
        for (kind, column, ids) in owned(item, &reach) {
            restored.extend(tx.mark_restored(kind, column, &ids, deletion.deleted_at).await?);
        }
        // The statements above wait for a running purge, and leave purged items as they are.
        let Some(place) = restored.iter().position(|other| *other == item) else {
            let purged_at = tx.present().await?;
            return Err(StoreError::Purged { item, purged_at });
        };
        restored.remove(place);
        tx.commit().await?;
        Ok(restored)
    }

    /// The items that would be deleted together with `item`, and the jobs that depend on it.
    ///
    /// # Errors
    /// When there is no such item, or it was deleted before.
    #[boxed]
    pub async fn dependents(&self, item: Item) -> Result<(Vec<Item>, Vec<Dependent>), StoreError> {
        let mut tx = self.begin_snapshot("looking for what depends on something").await?;
        let row = present(&mut tx, item).await?;
        let reach = reach(&mut tx, &row).await?;
        let found = dependents::of(&mut tx, &reach).await?;
        let mut along = Vec::new();
        for (kind, column, ids) in owned(item, &reach) {
            along.extend(tx.items_not_deleted(kind, column, &ids).await?);
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
                bytes += self.read("adding up files").size_of(kind, &ids).await?;
            }
        }
        Ok(bytes)
    }

    /// Items in the trash that were not deleted together with their owner, latest deletion first,
    /// beginning after `after`.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn trash(
        &self,
        after: Option<TrashPlace>,
        limit: u32,
    ) -> Result<Vec<Trashed>, StoreError> {
        let mut query = sql(trash());
        if let Some(TrashPlace { deleted_at, item }) = after {
            query.push(" WHERE (deleted_at, kind, id) < (").push_bind(deleted_at);
            query.push(", ").push_bind(item.kind.as_str()).push(", ").push_bind(item.id).push(")");
        }
        query.push(" ORDER BY deleted_at DESC, kind DESC, id DESC LIMIT ");
        query.push_bind(limit);
        let rows = query.rows(&mut self.read("reading the trash")).await?;
        let trashed = |row: &Row| {
            Ok(Trashed {
                item: Item::new(row.get("kind")?, row.get("id")?),
                name: row.get("name")?,
                result_name: row.get("result_name")?,
                bytes: row.get("bytes")?,
                deletion: deletion(row)?.ok_or_else(|| row.incomplete())?,
            })
        };
        rows.iter().map(trashed).collect()
    }
}

/// The rows that change together: their kind, the column that selects them, and its values.
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
        for (member, digest) in tx.owned_members(row.job).await? {
            jobs.push(member);
            digests.push(digest);
        }
    }
    Ok(Reach { jobs, digests, whole })
}

async fn known(tx: &mut Transaction, item: Item) -> Result<ItemRow, StoreError> {
    tx.item(item)
        .await?
        .ok_or_else(|| StoreError::not_found(item.kind.as_str(), item.id.to_string()))
}

/// The row of an item that was not deleted.
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
