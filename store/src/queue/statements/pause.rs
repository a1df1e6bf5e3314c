use super::{Database, Transaction};
use crate::{Queue, Timestamp};

impl Database {
    pub async fn queue(&self) -> Result<Queue, sqlx::Error> {
        let (paused_at, queued, running): (Option<Timestamp>, i64, i64) = sqlx::query_as(
            "SELECT (SELECT paused_at FROM queue), \
             (SELECT COUNT(*) FROM task WHERE state = 'queued'), \
             (SELECT COUNT(*) FROM task WHERE state = 'running')",
        )
        .fetch_one(&self.reader)
        .await?;
        Ok(Queue { paused_at, queued: queued.unsigned_abs(), running: running.unsigned_abs() })
    }
}

impl Transaction {
    /// Pauses the queue. If it is paused already, the time of the pause stays.
    pub async fn pause_queue(&mut self) -> Result<(), sqlx::Error> {
        let statement =
            sqlx::query(concat!("UPDATE queue SET paused_at = COALESCE(paused_at, ", now!(), ")"));
        self.execute(statement).await
    }

    pub async fn resume_queue(&mut self) -> Result<(), sqlx::Error> {
        self.execute(sqlx::query("UPDATE queue SET paused_at = NULL")).await?;
        self.ring().await
    }
}
