//! Deletes and restores things, and lists what depends on them.

use std::collections::{BTreeMap, BTreeSet};

use store::{DeletionOrder, Item, JobId, Respect, Timestamp, TrashPlace};
use wire::{Deleted, Dependents, ItemKind, Restored, Trash, TrashedItem};

use crate::app::App;
use crate::error::{ApiError, dependent};

impl App {
    /// The things that would be deleted together with one, and the jobs that depend on them.
    pub(crate) async fn dependents(&self, kind: ItemKind, id: i64) -> Result<Dependents, ApiError> {
        let item = Item::new(kind, id);
        let (along, jobs) = self.store.dependents(item).await?;
        let all: Vec<Item> = along.iter().copied().chain([item]).collect();
        let bytes = self.store.size_of(&all).await?;
        let jobs = jobs.iter().map(dependent).collect::<Result<_, _>>()?;
        Ok(Dependents { kind, id, along: items(along), bytes, jobs })
    }

    /// The name by which people know a thing, also one in the trash.
    pub(crate) async fn name_of(&self, kind: ItemKind, id: i64) -> Result<String, ApiError> {
        Ok(self.store.name_of(Item::new(kind, id)).await?)
    }

    /// The names of the results of jobs, by job. A result that nobody named has the name of its job.
    pub(crate) async fn result_names(
        &self,
        jobs: impl IntoIterator<Item = i64>,
    ) -> Result<BTreeMap<i64, String>, ApiError> {
        let jobs: BTreeSet<JobId> = jobs.into_iter().map(JobId).collect();
        let jobs: Vec<JobId> = jobs.into_iter().collect();
        let names = self.store.result_names(&jobs).await?;
        Ok(names.into_iter().map(|(job, name)| (job.0, name)).collect())
    }

    /// Moves a thing into the trash, with everything that it owns.
    pub(crate) async fn delete(
        &self,
        kind: ItemKind,
        id: i64,
        respect: Respect,
    ) -> Result<Deleted, ApiError> {
        let order = DeletionOrder { respect, keep: self.options.keep_deleted, reason: None };
        let deleted = self.store.delete(Item::new(kind, id), &order).await?;
        Ok(Deleted {
            kind,
            id,
            along: items(deleted.along),
            deleted_at: deleted.deleted_at.to_string(),
            purge_at: deleted.purge_at.to_string(),
        })
    }

    /// Restores a thing from the trash, with everything that was deleted together with it.
    pub(crate) async fn restore(&self, kind: ItemKind, id: i64) -> Result<Restored, ApiError> {
        let along = self.store.restore(Item::new(kind, id)).await?;
        Ok(Restored { kind, id, along: items(along) })
    }

    /// A page of the trash, latest deletion first.
    pub(crate) async fn trash(&self, limit: u32, before: Option<&str>) -> Result<Trash, ApiError> {
        let place = before.map(read_place).transpose()?;
        let found = self.store.trash(place, limit).await?;
        let is_full = found.len() == limit as usize;
        let next = found.last().filter(|_| is_full).map(|last| {
            let Item { kind, id } = last.item;
            format!("{}-{kind}-{id}", last.deletion.deleted_at.milliseconds())
        });
        let trashed = |row: store::Trashed| TrashedItem {
            kind: row.item.kind,
            id: row.item.id,
            name: row.name,
            result_name: row.result_name,
            bytes: row.bytes,
            deleted_at: row.deletion.deleted_at.to_string(),
            purge_at: row.deletion.purge_at.to_string(),
            reason: row.deletion.reason,
        };
        Ok(Trash { items: found.into_iter().map(trashed).collect(), next })
    }
}

fn read_place(text: &str) -> Result<TrashPlace, ApiError> {
    let mut parts = text.splitn(3, '-');
    let mut place = || {
        let moment = parts.next()?.parse().ok()?;
        let kind = parts.next()?.parse().ok()?;
        let id = parts.next()?.parse().ok()?;
        let deleted_at = Timestamp::from_milliseconds(moment);
        Some(TrashPlace { deleted_at, item: Item::new(kind, id) })
    };
    place().ok_or_else(|| ApiError::parameter("before", text, "the `next` of the page before"))
}

fn items(items: Vec<Item>) -> Vec<wire::Item> {
    items.into_iter().map(|Item { kind, id }| wire::Item { kind, id }).collect()
}
