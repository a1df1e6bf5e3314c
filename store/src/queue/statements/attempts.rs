use sqlx::types::Text;
use sqlx::{FromRow, Row};
use wire::AttemptOutcome;

use super::rows::optional_number;
use super::{Database, DbRow, Transaction};
use crate::{Attempt, Fence, JobId, Page};

impl Database {
    /// Newest first.
    pub async fn attempts(&self, job: JobId, page: Page) -> Result<Vec<Attempt>, sqlx::Error> {
        sqlx::query_as(
            "SELECT attempt.*, task.label FROM attempt JOIN task ON task.id = attempt.task \
             WHERE attempt.job = $1 AND attempt.id < $2 ORDER BY attempt.id DESC LIMIT $3",
        )
        .bind(job)
        .bind(page.before())
        .bind(page.limit())
        .fetch_all(&self.reader)
        .await
    }

    pub async fn has_begun_a_task(&self, worker: &str) -> Result<bool, sqlx::Error> {
        let begun: Option<i32> =
            sqlx::query_scalar("SELECT 1 FROM attempt WHERE worker = $1 LIMIT 1")
                .bind(worker)
                .fetch_optional(&self.reader)
                .await?;
        Ok(begun.is_some())
    }
}

impl Transaction {
    /// Does nothing for a task that was claimed by a version without attempts.
    pub async fn end_attempt(
        &mut self,
        fence: Fence,
        outcome: AttemptOutcome,
        reason: Option<&str>,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "UPDATE attempt SET outcome = $1, reason = $2, ended_at = ",
            now!(),
            " WHERE task = $3 AND epoch = $4"
        ))
        .bind(outcome.as_str())
        .bind(reason)
        .bind(fence.task)
        .bind(fence.epoch);
        self.execute(statement).await
    }

    /// Records why a worker gave its last task back, unless a reason is known.
    pub async fn explain_release(&mut self, worker: &str, reason: &str) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "UPDATE attempt SET reason = $1 WHERE id = (SELECT MAX(id) FROM attempt WHERE worker = $2) \
             AND outcome = 'released' AND reason IS NULL",
        )
        .bind(reason)
        .bind(worker);
        self.execute(statement).await
    }
}

impl FromRow<'_, DbRow> for Attempt {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        let outcome: Option<Text<AttemptOutcome>> = row.try_get("outcome")?;
        Ok(Self {
            id: row.try_get("id")?,
            task: row.try_get("task")?,
            label: row.try_get("label")?,
            epoch: row.try_get("epoch")?,
            worker: row.try_get("worker")?,
            outcome: outcome.map(|Text(outcome)| outcome),
            reason: row.try_get("reason")?,
            started_at: row.try_get("started_at")?,
            ended_at: row.try_get("ended_at")?,
            log_bytes: optional_number(row, "log_bytes")?,
        })
    }
}
