//! Sent files that nobody needs any more: every job that read them is purged, or none ever did.

use std::time::Duration;

use crate::database::column::json;
use crate::database::query::sql;
use crate::database::{Reading, Scope, Transaction};
use crate::trash::garbage::{Garbage, GarbageKind, PURGING, Ripe};
use crate::{JobId, Store, StoreError, Timestamp, Upload};

impl Store {
    /// Deletes files whose requests ended without an import, for example because one of several
    /// files did not arrive.
    pub(super) async fn purge_unclaimed_uploads(
        &self,
        orphaned: Duration,
    ) -> Result<Vec<Garbage>, StoreError> {
        let sent_before = self.limit(Ripe::After(orphaned)).await?.moment;
        // A submission may be about to refer to one of them.
        let mut tx = self.begin(Scope::Queue, PURGING).await?;
        let uploads = tx.delete_unclaimed_uploads(sent_before).await?;
        tx.commit().await?;
        Ok(self.delete_uploads(uploads).await)
    }

    /// Deletes the objects of uploads that have no row any more.
    pub(super) async fn delete_uploads(&self, uploads: Vec<Upload>) -> Vec<Garbage> {
        let deleted = uploads.iter().map(of_upload).collect();
        let paths = uploads.into_iter().map(|upload| upload.object.path);
        self.objects().delete(paths.collect()).await;
        deleted
    }
}

pub(super) fn of_upload(Upload { name, object, .. }: &Upload) -> Garbage {
    Garbage {
        kind: GarbageKind::Upload(object.sha256),
        name: name.clone(),
        files: 1,
        bytes: object.size,
    }
}

impl Reading<'_> {
    /// Sent files that only purged jobs have read, or jobs among `jobs`.
    pub async fn unread_uploads(&mut self, jobs: &[JobId]) -> Result<Vec<Upload>, StoreError> {
        sql("SELECT * FROM upload WHERE EXISTS (SELECT 1 FROM job_input \
                 WHERE digest = upload.sha256) AND NOT EXISTS (SELECT 1 FROM job_input JOIN job \
                 ON job.id = job_input.job WHERE job_input.digest = upload.sha256 \
                 AND job.purged_at IS NULL AND job.id NOT IN {ids $1}) ORDER BY sha256")
        .bind(json(&jobs))
        .all(self)
        .await
    }

    /// Files sent before a moment that no job was ever to read.
    pub async fn unclaimed_uploads(
        &mut self,
        sent_before: Timestamp,
    ) -> Result<Vec<Upload>, StoreError> {
        sql("SELECT * FROM upload WHERE created_at < $1 AND NOT EXISTS (SELECT 1 FROM job_input \
                 WHERE digest = upload.sha256) ORDER BY sha256")
        .bind(sent_before)
        .all(self)
        .await
    }
}

impl Transaction {
    /// Deletes sent files that only purged jobs have read. Returns them.
    pub async fn delete_unread_uploads(&mut self) -> Result<Vec<Upload>, StoreError> {
        sql(
            "DELETE FROM upload WHERE EXISTS (SELECT 1 FROM job_input WHERE digest = upload.sha256) \
             AND NOT EXISTS (SELECT 1 FROM job_input JOIN job ON job.id = job_input.job \
                 WHERE job_input.digest = upload.sha256 AND job.purged_at IS NULL) RETURNING *",
        )
        .all(self)
        .await
    }

    /// Deletes files sent before a moment that no job was ever to read. Returns them.
    pub async fn delete_unclaimed_uploads(
        &mut self,
        sent_before: Timestamp,
    ) -> Result<Vec<Upload>, StoreError> {
        sql("DELETE FROM upload WHERE created_at < $1 AND NOT EXISTS (SELECT 1 FROM job_input \
                 WHERE digest = upload.sha256) RETURNING *")
        .bind(sent_before)
        .all(self)
        .await
    }
}
