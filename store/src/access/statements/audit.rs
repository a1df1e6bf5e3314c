use sqlx::{FromRow, Row};

use super::rows::number;
use super::{Database, DbRow, Transaction};
use crate::{AuditEntry, AuditRecord, Page};

impl Database {
    pub async fn audit(
        &self,
        actor: Option<&str>,
        page: Page,
    ) -> Result<Vec<AuditRecord>, sqlx::Error> {
        sqlx::query_as(
            "SELECT * FROM audit WHERE (CAST($1 AS TEXT) IS NULL OR actor = $1) AND id < $2 \
             ORDER BY id DESC LIMIT $3",
        )
        .bind(actor)
        .bind(page.before.unwrap_or(i64::MAX))
        .bind(i64::from(page.limit))
        .fetch_all(&self.reader)
        .await
    }
}

impl Transaction {
    pub async fn insert_audit(&mut self, entry: &AuditEntry, keep: u32) -> Result<(), sqlx::Error> {
        let id: i64 = sqlx::query_scalar(concat!(
            "INSERT INTO audit (at, actor, address, method, target, status, made) VALUES (",
            now!(),
            ", $1, $2, $3, $4, $5, $6) RETURNING id"
        ))
        .bind(&entry.actor)
        .bind(&entry.address)
        .bind(&entry.method)
        .bind(&entry.path)
        .bind(i64::from(entry.status))
        .bind(&entry.made)
        .fetch_one(self.connection())
        .await?;
        let forget = sqlx::query("DELETE FROM audit WHERE id <= $1").bind(id - i64::from(keep));
        self.execute(forget).await
    }
}

impl FromRow<'_, DbRow> for AuditRecord {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            at: row.try_get("at")?,
            entry: AuditEntry {
                actor: row.try_get("actor")?,
                address: row.try_get("address")?,
                method: row.try_get("method")?,
                path: row.try_get("target")?,
                status: number(row, "status")?,
                made: row.try_get("made")?,
            },
        })
    }
}
