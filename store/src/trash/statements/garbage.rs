use sqlx::types::Json;
use sqlx::{QueryBuilder, Row};
use wire::ItemKind;

use super::rows::{number, stored_object};
use super::{Database, Db, DbRow, Transaction};
use crate::trash::garbage::Limit;
use crate::{Garbage, GarbageKind, Item, JobId, StoredObject, TrackedRunId};

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

impl Database {
    /// Items whose date has come, sorted by id. A job waits for all items that it left.
    pub async fn ripe_items(
        &self,
        kind: ItemKind,
        limit: Limit,
    ) -> Result<Vec<Garbage>, sqlx::Error> {
        let column = limit.column;
        let measured = |what: &str| match files_of(kind) {
            Some(table) => format!(
                "(SELECT CAST(COALESCE({what}, 0) AS BIGINT) FROM {table} WHERE {table}.{kind} = {kind}.id)"
            ),
            None => "CAST(0 AS BIGINT)".to_owned(),
        };
        let mut query = QueryBuilder::<Db>::new(format!(
            "SELECT {kind}.id, maker.name, {} AS files, {} AS bytes FROM {kind} \
             JOIN job AS maker ON maker.id = {kind}.{} \
             WHERE {kind}.deleted_at IS NOT NULL AND {kind}.purged_at IS NULL AND {kind}.{column} <= ",
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
        let rows = query.build().fetch_all(&self.reader).await?;
        let garbage = |row: &DbRow| {
            Ok(Garbage {
                kind: GarbageKind::Item(Item::new(kind, row.try_get("id")?)),
                name: row.try_get("name")?,
                files: number(row, "files")?,
                bytes: number(row, "bytes")?,
            })
        };
        rows.iter().map(garbage).collect()
    }

    pub async fn ripe_tracked_runs(&self, limit: Limit) -> Result<Vec<Garbage>, sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(format!(
            "SELECT identifier, name, \
             (SELECT COUNT(*) FROM tracked_artifact AS file WHERE file.run = tracked_run.id) AS files, \
             (SELECT CAST(COALESCE(SUM(size), 0) AS BIGINT) FROM tracked_artifact AS file \
              WHERE file.run = tracked_run.id) AS bytes \
             FROM tracked_run WHERE is_deleted AND {} <= ",
            limit.column
        ));
        query.push_bind(limit.moment).push(" ORDER BY id");
        let rows = query.build().fetch_all(&self.reader).await?;
        let garbage = |row: &DbRow| {
            Ok(Garbage {
                kind: GarbageKind::TrackedRun(row.try_get("identifier")?),
                name: row.try_get("name")?,
                files: number(row, "files")?,
                bytes: number(row, "bytes")?,
            })
        };
        rows.iter().map(garbage).collect()
    }

    /// Sent files that only purged jobs have read, or jobs among `jobs`.
    pub async fn unread_uploads(&self, jobs: &[JobId]) -> Result<Vec<Garbage>, sqlx::Error> {
        let rows = sqlx::query(concat!(
            "SELECT * FROM upload WHERE EXISTS (SELECT 1 FROM job_input WHERE digest = upload.sha256) \
             AND NOT EXISTS (SELECT 1 FROM job_input JOIN job ON job.id = job_input.job \
                 WHERE job_input.digest = upload.sha256 AND job.purged_at IS NULL AND job.id NOT IN ",
            listed_ids!("$1"),
            ") ORDER BY sha256"
        ))
        .bind(Json(jobs))
        .fetch_all(&self.reader)
        .await?;
        let garbage = |row: &DbRow| {
            let object = stored_object(row)?;
            Ok(Garbage {
                kind: GarbageKind::Upload(object.sha256),
                name: row.try_get("name")?,
                files: 1,
                bytes: object.size,
            })
        };
        rows.iter().map(garbage).collect()
    }
}

impl Transaction {
    /// Marks an item as purged. Returns whether it was ripe and this transaction is the one that
    /// purges it. A job has to wait for all items that it left.
    pub async fn mark_purged(&mut self, item: Item, limit: Limit) -> Result<bool, sqlx::Error> {
        let kind = item.kind;
        let mut query = QueryBuilder::<Db>::new(format!("UPDATE {kind} SET purged_at = "));
        query.push(now!()).push(" WHERE deleted_at IS NOT NULL AND purged_at IS NULL AND id = ");
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
        let marked = query.build().execute(self.connection()).await?;
        Ok(marked.rows_affected() > 0)
    }

    /// Adds the attempts of a job that have ended to those of jobs that were purged before.
    pub async fn keep_count_of_attempts(&mut self, job: JobId) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "INSERT INTO purged_attempts (kind, outcome, number) \
             SELECT job.kind, attempt.outcome, COUNT(*) FROM attempt JOIN job ON job.id = attempt.job \
             WHERE attempt.job = $1 AND attempt.outcome IS NOT NULL \
             GROUP BY job.kind, attempt.outcome ORDER BY job.kind, attempt.outcome \
             ON CONFLICT (kind, outcome) DO UPDATE SET number = purged_attempts.number + excluded.number",
        );
        self.execute(statement.bind(job)).await
    }

    /// Deletes the rows about an item in other tables. Returns the paths and sizes of the objects
    /// that they named.
    pub async fn delete_details(&mut self, item: Item) -> Result<Vec<(String, u64)>, sqlx::Error> {
        let mut files = Vec::new();
        if let Some(table) = files_of(item.kind) {
            let mut query =
                QueryBuilder::<Db>::new(format!("DELETE FROM {table} WHERE {} = ", item.kind));
            query.push_bind(item.id).push(" RETURNING path, size");
            let rows = query.build().fetch_all(self.connection()).await?;
            for row in &rows {
                files.push((row.try_get("path")?, number(row, "size")?));
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
            let mut query =
                QueryBuilder::<Db>::new(format!("DELETE FROM {table} WHERE {} = ", item.kind));
            query.push_bind(item.id);
            query.build().execute(self.connection()).await?;
        }
        Ok(files)
    }

    /// Locks a ripe tracked run, so that nobody else writes to it until the transaction ends.
    pub async fn ripe_tracked_run(
        &mut self,
        identifier: &str,
        limit: Limit,
    ) -> Result<Option<TrackedRunId>, sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new("SELECT id FROM tracked_run WHERE identifier = ");
        query.push_bind(identifier.to_owned());
        query.push(format!(" AND is_deleted AND {} <= ", limit.column)).push_bind(limit.moment);
        query.push(locked!());
        query.build_query_scalar().fetch_optional(self.connection()).await
    }

    /// Deletes a tracked run with everything it has. Returns the paths and sizes of its objects.
    pub async fn delete_tracked_run(
        &mut self,
        run: TrackedRunId,
    ) -> Result<Vec<(String, u64)>, sqlx::Error> {
        let rows = sqlx::query("DELETE FROM tracked_artifact WHERE run = $1 RETURNING path, size")
            .bind(run)
            .fetch_all(self.connection())
            .await?;
        sqlx::query("DELETE FROM tracked_run WHERE id = $1")
            .bind(run)
            .execute(self.connection())
            .await?;
        rows.iter().map(|row| Ok((row.try_get("path")?, number(row, "size")?))).collect()
    }

    /// Deletes sent files that only purged jobs have read. Returns them with their names.
    pub async fn delete_unread_uploads(
        &mut self,
    ) -> Result<Vec<(StoredObject, String)>, sqlx::Error> {
        let rows = sqlx::query(
            "DELETE FROM upload WHERE EXISTS (SELECT 1 FROM job_input WHERE digest = upload.sha256) \
             AND NOT EXISTS (SELECT 1 FROM job_input JOIN job ON job.id = job_input.job \
                 WHERE job_input.digest = upload.sha256 AND job.purged_at IS NULL) RETURNING *",
        )
        .fetch_all(self.connection())
        .await?;
        rows.iter().map(|row| Ok((stored_object(row)?, row.try_get("name")?))).collect()
    }

    /// Deletes rows of purged jobs that no other job refers to. Returns how many it deleted. After
    /// that, others may be free.
    pub async fn delete_purged_jobs(&mut self) -> Result<u64, sqlx::Error> {
        let deleted = sqlx::query(
            "DELETE FROM job WHERE deleted_at IS NOT NULL AND purged_at IS NOT NULL \
             AND NOT EXISTS (SELECT 1 FROM job_need WHERE job_need.needs = job.id) \
             AND NOT EXISTS (SELECT 1 FROM pipeline_member AS member WHERE member.job = job.id) \
             AND NOT EXISTS (SELECT 1 FROM job_input AS input \
                 WHERE input.digest = job.digest AND input.job <> job.id)",
        )
        .execute(self.connection())
        .await?;
        Ok(deleted.rows_affected())
    }

    /// Deletes experiments without runs, except the two that always exist.
    pub async fn delete_empty_experiments(&mut self, limit: Limit) -> Result<(), sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(format!(
            "DELETE FROM tracked_experiment WHERE is_deleted AND id > 1 AND {} <= ",
            limit.column
        ));
        query.push_bind(limit.moment).push(
            " AND NOT EXISTS (SELECT 1 FROM tracked_run WHERE experiment = tracked_experiment.id)",
        );
        query.build().execute(self.connection()).await?;
        Ok(())
    }
}
