//! The audit log: who requested a change, and how the request was answered.

use store::AuditRecord;
use wire::{Audit, AuditEntry};

use crate::app::{App, Paging};
use crate::error::ApiError;

impl App {
    pub(crate) async fn audit(
        &self,
        actor: Option<&str>,
        paging: Paging,
    ) -> Result<Audit, ApiError> {
        let records = self.store.audit(actor, paging.into()).await?;
        let next = paging.next(records.len(), records.last().map(|record| record.id));
        Ok(Audit { entries: records.into_iter().map(entry).collect(), next })
    }
}

fn entry(AuditRecord { id, at, entry }: AuditRecord) -> AuditEntry {
    let store::AuditEntry { actor, address, method, path, status, made } = entry;
    AuditEntry { id, at: at.to_string(), actor, address, method, path, status, made }
}
