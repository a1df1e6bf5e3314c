//! Permanent deletion of items whose time in the trash is over, and of objects without a row.
//!
//! Rows are deleted first, and their objects afterwards. A process that is killed in between leaves
//! objects without a row, and the next sweep finds them. No row ever names a deleted object.

use std::time::Duration;

use spec::Digest;
use wire::ItemKind;

use crate::database::query::{Row, sql};
use crate::database::{Reading, Scope, Transaction};
use crate::trash::leftovers::Leftovers;
use crate::trash::names::name_of;
use crate::trash::unused_uploads::of_upload;
use crate::{Item, JobId, Store, StoreError, Timestamp, TrackedRunId, boxed};

/// When an item in the trash may be deleted permanently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ripe {
    /// At the date that was set when it was deleted. The database's clock may be ahead by `leap`.
    AtItsDate {
        /// How far the clock may be ahead.
        leap: Duration,
    },
    /// When it was deleted at least this long ago.
    After(Duration),
}

/// Something that is deleted permanently.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Garbage {
    /// Which item or leftover it is.
    pub kind: GarbageKind,
    /// The name of its job, its run or its file.
    pub name: String,
    /// Number of files that go.
    pub files: u64,
    /// Number of bytes that go.
    pub bytes: u64,
}

/// What is deleted for good.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GarbageKind {
    /// An item in the trash.
    Item(Item),
    /// A run logged by an MLflow client, under the name that clients use.
    TrackedRun(String),
    /// An uploaded file that no remaining job reads, or that no job was ever to read.
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

pub(super) const PURGING: &str = "purging the trash";

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
        let sent_before = self.limit(Ripe::After(orphaned)).await?.moment;
        let unclaimed = self.read(PURGING).unclaimed_uploads(sent_before).await?;
        found.extend(unclaimed.iter().map(of_upload));
        found.extend(of_leftovers(&self.leftovers(orphaned).await?));
        Ok(found)
    }

    /// Permanently deletes ripe items, uploads without an import, objects without a row and
    /// unfinished files. All but the items are older than `orphaned`. Returns them.
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
        deleted.extend(self.purge_unclaimed_uploads(orphaned).await?);
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

    pub(super) async fn limit(&self, ripe: Ripe) -> Result<Limit, StoreError> {
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
            found.extend(self.read(PURGING).ripe_items(kind, limit).await?);
        }
        let job = |garbage: &Garbage| match garbage.kind {
            GarbageKind::Item(Item { kind: ItemKind::Job, id }) => Some(JobId(id)),
            _ => None,
        };
        let jobs: Vec<JobId> = found.iter().filter_map(job).collect();
        found.extend(self.read(PURGING).ripe_tracked_runs(limit).await?);
        let unread = self.read(PURGING).unread_uploads(&jobs).await?;
        found.extend(unread.iter().map(of_upload));
        Ok(found)
    }

    /// The item's objects by path and size; `None` if it is no longer ripe.
    async fn purge_item(
        &self,
        item: Item,
        limit: Limit,
    ) -> Result<Option<Vec<(String, u64)>>, StoreError> {
        let mut tx = self.begin(Scope::Rows, PURGING).await?;
        if !tx.mark_purged(item, limit).await? {
            return Ok(None);
        }
        if item.kind == ItemKind::Job {
            tx.keep_count_of_attempts(JobId(item.id)).await?;
        }
        let files = tx.delete_details(item).await?;
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
        let Some(run) = tx.ripe_tracked_run(identifier, limit).await? else {
            return Ok(None);
        };
        let files = tx.delete_tracked_run(run).await?;
        tx.commit().await?;
        self.delete_objects(&files).await;
        Ok(Some(files))
    }

    /// Deletes what the purge leaves unused: uploaded files, rows of jobs that no other job refers
    /// to, experiments without runs.
    async fn purge_remains(&self, limit: Limit) -> Result<Vec<Garbage>, StoreError> {
        // A submission may be about to refer to one of them.
        let mut tx = self.begin(Scope::Queue, PURGING).await?;
        let uploads = tx.delete_unread_uploads().await?;
        while tx.delete_purged_jobs().await? > 0 {}
        tx.delete_empty_experiments(limit).await?;
        tx.commit().await?;
        Ok(self.delete_uploads(uploads).await)
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

/// The table with the files of a kind of item.
const fn files_of(kind: ItemKind) -> Option<&'static str> {
    match kind {
        ItemKind::Job => None,
        ItemKind::Run => Some("artifact"),
        ItemKind::Dataset => Some("shard_file"),
        ItemKind::Checkpoint => Some("checkpoint_file"),
    }
}

/// The kinds of items that jobs leave.
const LEFT: [ItemKind; 3] = [ItemKind::Run, ItemKind::Dataset, ItemKind::Checkpoint];

impl Reading<'_> {
    /// Items whose date has come, sorted by id. A job waits for all items that it left.
    pub async fn ripe_items(
        &mut self,
        kind: ItemKind,
        limit: Limit,
    ) -> Result<Vec<Garbage>, StoreError> {
        let column = limit.column;
        let measured = |what: &str| match files_of(kind) {
            Some(table) => format!(
                "(SELECT CAST(COALESCE({what}, 0) AS BIGINT) FROM {table} WHERE {table}.{kind} = {kind}.id)"
            ),
            None => "CAST(0 AS BIGINT)".to_owned(),
        };
        let mut query = sql(format!(
            "SELECT {kind}.id, {} AS name, {} AS files, {} AS bytes FROM {kind} \
             JOIN job AS maker ON maker.id = {kind}.{} \
             WHERE {kind}.deleted_at IS NOT NULL AND {kind}.purged_at IS NULL AND {kind}.{column} <= ",
            name_of(kind, "maker"),
            measured("COUNT(*)"),
            measured("SUM(size)"),
            if kind == ItemKind::Job { "id" } else { "job" },
        ));
        query.push_bind(limit.moment);
        if kind == ItemKind::Job {
            for left in LEFT {
                query.push(format!(
                    " AND NOT EXISTS (SELECT 1 FROM {left} WHERE {left}.job = job.id \
                     AND {left}.purged_at IS NULL AND {left}.{column} > "
                ));
                query.push_bind(limit.moment).push(")");
            }
        }
        query.push(format!(" ORDER BY {kind}.id"));
        let rows = query.rows(self).await?;
        let garbage = |row: &Row| {
            Ok(Garbage {
                kind: GarbageKind::Item(Item::new(kind, row.get("id")?)),
                name: row.get("name")?,
                files: row.get("files")?,
                bytes: row.get("bytes")?,
            })
        };
        rows.iter().map(garbage).collect()
    }

    pub async fn ripe_tracked_runs(&mut self, limit: Limit) -> Result<Vec<Garbage>, StoreError> {
        let mut query = sql(format!(
            "SELECT identifier, name, \
             (SELECT COUNT(*) FROM tracked_artifact AS file WHERE file.run = tracked_run.id) AS files, \
             (SELECT CAST(COALESCE(SUM(size), 0) AS BIGINT) FROM tracked_artifact AS file \
              WHERE file.run = tracked_run.id) AS bytes \
             FROM tracked_run WHERE is_deleted AND {} <= ",
            limit.column
        ));
        query.push_bind(limit.moment).push(" ORDER BY id");
        let rows = query.rows(self).await?;
        let garbage = |row: &Row| {
            Ok(Garbage {
                kind: GarbageKind::TrackedRun(row.get("identifier")?),
                name: row.get("name")?,
                files: row.get("files")?,
                bytes: row.get("bytes")?,
            })
        };
        rows.iter().map(garbage).collect()
    }
}

impl Transaction {
    /// Marks an item as purged. Returns whether it was ripe and this transaction is the one that
    /// purges it. A job has to wait for all items that it left.
    pub async fn mark_purged(&mut self, item: Item, limit: Limit) -> Result<bool, StoreError> {
        let kind = item.kind;
        let mut query = sql(format!("UPDATE {kind} SET purged_at = "));
        query.push("{now}").push(" WHERE deleted_at IS NOT NULL AND purged_at IS NULL AND id = ");
        query.push_bind(item.id).push(format!(" AND {} <= ", limit.column));
        query.push_bind(limit.moment);
        if kind == ItemKind::Job {
            for left in LEFT {
                query.push(format!(
                    " AND NOT EXISTS (SELECT 1 FROM {left} WHERE {left}.job = job.id \
                     AND {left}.purged_at IS NULL)"
                ));
            }
        }
        let marked = query.changed(self).await?;
        Ok(marked > 0)
    }

    /// Adds the attempts of a job that have ended to those of jobs that were purged before.
    pub async fn keep_count_of_attempts(&mut self, job: JobId) -> Result<(), StoreError> {
        sql(
            "INSERT INTO purged_attempts (kind, outcome, number) \
             SELECT job.kind, attempt.outcome, COUNT(*) FROM attempt JOIN job ON job.id = attempt.job \
             WHERE attempt.job = $1 AND attempt.outcome IS NOT NULL \
             GROUP BY job.kind, attempt.outcome ORDER BY job.kind, attempt.outcome \
             ON CONFLICT (kind, outcome) DO UPDATE SET number = purged_attempts.number + excluded.number",
        ).bind(job).run(self).await
    }

    /// Deletes the rows about an item in other tables. Returns the paths and sizes of the objects
    /// that they named.
    pub async fn delete_details(&mut self, item: Item) -> Result<Vec<(String, u64)>, StoreError> {
        let mut files = Vec::new();
        if let Some(table) = files_of(item.kind) {
            let mut query = sql(format!("DELETE FROM {table} WHERE {} = ", item.kind));
            query.push_bind(item.id).push(" RETURNING path, size");
            let rows = query.rows(self).await?;
            for row in &rows {
                files.push((row.get("path")?, row.get("size")?));
            }
        }
        let more: &[&str] = match item.kind {
            // Attempts and their logs are deleted with their tasks.
            ItemKind::Job => &["task", "idempotency_key"],
            ItemKind::Run => &["metric", "metric_latest"],
            ItemKind::Dataset => &["shard"],
            ItemKind::Checkpoint => &[],
        };
        for table in more {
            let mut query = sql(format!("DELETE FROM {table} WHERE {} = ", item.kind));
            query.push_bind(item.id);
            query.changed(self).await?;
        }
        Ok(files)
    }

    /// Locks a ripe tracked run, so that nobody else writes to it until the transaction ends.
    pub async fn ripe_tracked_run(
        &mut self,
        identifier: &str,
        limit: Limit,
    ) -> Result<Option<TrackedRunId>, StoreError> {
        let mut query = sql("SELECT id FROM tracked_run WHERE identifier = ");
        query.push_bind(identifier.to_owned());
        query.push(format!(" AND is_deleted AND {} <= ", limit.column)).push_bind(limit.moment);
        query.push("{locked}");
        query.optional(self).await
    }

    /// Deletes a tracked run with everything it has. Returns the paths and sizes of its objects.
    pub async fn delete_tracked_run(
        &mut self,
        run: TrackedRunId,
    ) -> Result<Vec<(String, u64)>, StoreError> {
        let rows = sql("DELETE FROM tracked_artifact WHERE run = $1 RETURNING path, size")
            .bind(run)
            .rows(self)
            .await?;
        sql("DELETE FROM tracked_run WHERE id = $1").bind(run).changed(self).await?;
        rows.iter().map(|row| Ok((row.get("path")?, row.get("size")?))).collect()
    }

    /// Deletes rows of purged jobs that no other job refers to. Returns how many it deleted. After
    /// that, others may be free.
    pub async fn delete_purged_jobs(&mut self) -> Result<u64, StoreError> {
        let deleted =
            sql("DELETE FROM job WHERE deleted_at IS NOT NULL AND purged_at IS NOT NULL \
             AND NOT EXISTS (SELECT 1 FROM job_need WHERE job_need.needs = job.id) \
             AND NOT EXISTS (SELECT 1 FROM pipeline_member AS member WHERE member.job = job.id) \
             AND NOT EXISTS (SELECT 1 FROM job_input AS input \
                 WHERE input.digest = job.digest AND input.job <> job.id)")
            .changed(self)
            .await?;
        Ok(deleted)
    }

    /// Deletes experiments without runs, except the two that always exist.
    pub async fn delete_empty_experiments(&mut self, limit: Limit) -> Result<(), StoreError> {
        let mut query = sql(format!(
            "DELETE FROM tracked_experiment WHERE is_deleted AND id > 1 AND {} <= ",
            limit.column
        ));
        query.push_bind(limit.moment).push(
            " AND NOT EXISTS (SELECT 1 FROM tracked_run WHERE experiment = tracked_experiment.id)",
        );
        query.changed(self).await?;
        Ok(())
    }
}
