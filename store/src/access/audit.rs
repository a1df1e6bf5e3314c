//! The audit log: who asked for a change, and what became of it.

use crate::boxed;
use crate::database::{Scope, sql};
use crate::{Page, Store, StoreError, Timestamp};

/// Number of entries kept. Older ones are deleted.
pub const AUDIT_ENTRIES: u32 = 100_000;

/// A request that changed something, or was refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditEntry {
    /// Name of the token that let the request in, or of what else let it in.
    pub actor: String,
    /// The address that the request came from.
    pub address: String,
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
    pub id: i64,
    pub at: Timestamp,
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
        sql!(&mut tx, insert_audit(entry, AUDIT_ENTRIES))?;
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
        sql!(self.database(), "reading the audit log", audit(actor, page))
    }
}
