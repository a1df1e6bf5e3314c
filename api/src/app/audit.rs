//! The audit log: who requested a change, and how the request was answered.

use store::AuditRecord;
use wire::{Audit, AuditEntry};

use crate::app::{App, Paging};
use crate::error::ApiError;

impl App {
    /// Adds to the audit log. If that fails, the request has been answered already, so the entry
    /// goes to the server's log.
    pub async fn record(&self, entry: &store::AuditEntry) {
        let store::AuditEntry { actor, address, method, path, status, made } = entry;
        tracing::info!(actor, address, method, path, status, made, "a request changed something");
        self.record_refused(entry).await;
    }

    /// Adds a request to the audit log that changed nothing.
    pub async fn record_refused(&self, entry: &store::AuditEntry) {
        let store::AuditEntry { actor, method, path, .. } = entry;
        if let Err(error) = self.store.record_audit(entry).await {
            let error = spec::causes(&error);
            tracing::error!(error, actor, method, path, "the audit log cannot be written");
        }
    }

    pub async fn audit(&self, actor: Option<&str>, paging: Paging) -> Result<Audit, ApiError> {
        let records = self.store.audit(actor, paging.into()).await?;
        let next = paging.next(records.len(), records.last().map(|record| record.id));
        Ok(Audit { entries: records.into_iter().map(entry).collect(), next })
    }
}

fn entry(AuditRecord { id, at, entry }: AuditRecord) -> AuditEntry {
    let store::AuditEntry { actor, address, method, path, status, made } = entry;
    AuditEntry { id, at: at.to_string(), actor, address, method, path, status, made }
}
