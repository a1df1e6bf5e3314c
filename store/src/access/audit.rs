//! The audit log: who asked for a change, and what became of it.

use crate::database::query::{from_row, sql};
use crate::database::{Scope, Transaction};
use crate::{Page, Store, StoreError, Timestamp, boxed};

/// Number of entries kept. Older ones are deleted.
pub const AUDIT_ENTRIES: u32 = 100_000;

/// A request that changed something, or was refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditEntry {
    /// Name of the token that let the request in, or of what else let it in.
    pub actor: String,
    /// The address that the request came from.
    pub address: String,
    /// The HTTP method.
    pub method: String,
    /// The path and the query.
    pub path: String,
    /// The status of the answer.
    pub status: u16,
    /// Path of the resource that the request created.
    pub made: Option<String>,
}

/// An entry with its id and its time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditRecord {
    /// Its place in the log. Ids grow with time.
    pub id: i64,
    /// When the request was answered.
    pub at: Timestamp,
    /// The request.
    pub entry: AuditEntry,
}

impl Store {
    /// Adds an entry, and deletes all but the newest [`AUDIT_ENTRIES`].
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn record_audit(&self, entry: &AuditEntry) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "writing to the audit log").await?;
        tx.insert_audit(entry, AUDIT_ENTRIES).await?;
        tx.commit().await
    }

    /// Lists entries, newest first; only those of `actor` if it is given.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn audit(
        &self,
        actor: Option<&str>,
        page: Page,
    ) -> Result<Vec<AuditRecord>, StoreError> {
        sql("SELECT * FROM audit WHERE (CAST($1 AS TEXT) IS NULL OR actor = $1) AND id < $2 \
             ORDER BY id DESC LIMIT $3")
        .bind(actor)
        .bind(page.before.unwrap_or(i64::MAX))
        .bind(page.limit)
        .all(&mut self.read("reading the audit log"))
        .await
    }
}

impl Transaction {
    pub async fn insert_audit(&mut self, entry: &AuditEntry, keep: u32) -> Result<(), StoreError> {
        let id: i64 = sql("INSERT INTO audit (at, actor, address, method, target, status, made) \
             VALUES ({now}, $1, $2, $3, $4, $5, $6) RETURNING id")
        .bind(&entry.actor)
        .bind(&entry.address)
        .bind(&entry.method)
        .bind(&entry.path)
        .bind(entry.status)
        .bind(&entry.made)
        .one(self)
        .await?;
        sql("DELETE FROM audit WHERE id <= $1").bind(id - i64::from(keep)).run(self).await
    }
}

from_row!(AuditRecord {
    id, at,
    ..row =>
    entry: AuditEntry {
        actor: row.get("actor")?,
        address: row.get("address")?,
        method: row.get("method")?,
        path: row.get("target")?,
        status: row.get("status")?,
        made: row.get("made")?,
    },
});
