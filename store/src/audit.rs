//! The audit log: who asked for a change, and what became of it.

use crate::boxed;
use crate::database::{Scope, sql};
use crate::{Page, Store, StoreError, Timestamp};

/// Entries that are kept; the oldest make room.
pub const AUDIT_ENTRIES: u32 = 100_000;

/// A request that changed something, or tried to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditEntry {
    /// Name of the token that let the request in, or what else did.
    pub actor: String,
    /// The address that the request came from.
    pub address: String,
    pub method: String,
    /// With its query.
    pub path: String,
    /// The answer's.
    pub status: u16,
    /// Path of what the request made.
    pub made: Option<String>,
}

/// An entry, with its place and moment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditRecord {
    pub id: i64,
    pub at: Timestamp,
    pub entry: AuditEntry,
}

impl Store {
    /// Adds an entry; all but the newest [`AUDIT_ENTRIES`] are forgotten.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn record_audit(&self, entry: &AuditEntry) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "writing to the audit log").await?;
        sql!(&mut tx, insert_audit(entry, AUDIT_ENTRIES))?;
        tx.commit().await
    }

    /// Newest first; of one actor, if any is named.
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
