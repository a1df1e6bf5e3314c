use sqlx::types::Text;
use wire::{AttemptOutcome, JobState, TaskState};

use super::Database;
use crate::lists::census::Census;

impl Database {
    pub async fn census(&self) -> Result<Census, sqlx::Error> {
        let jobs: Vec<(String, Text<JobState>, i64)> =
            sqlx::query_as("SELECT kind, state, COUNT(*) FROM job GROUP BY kind, state")
                .fetch_all(&self.reader)
                .await?;
        let tasks: Vec<(String, Text<TaskState>, i64)> = sqlx::query_as(
            "SELECT job.kind, task.state, COUNT(*) FROM task JOIN job ON job.id = task.job \
             GROUP BY job.kind, task.state",
        )
        .fetch_all(&self.reader)
        .await?;
        let attempts: Vec<(String, Option<Text<AttemptOutcome>>, i64)> = sqlx::query_as(
            "SELECT kind, outcome, CAST(SUM(number) AS BIGINT) FROM \
             (SELECT job.kind, attempt.outcome, COUNT(*) AS number FROM attempt \
              JOIN job ON job.id = attempt.job GROUP BY job.kind, attempt.outcome \
              UNION ALL SELECT kind, outcome, number FROM purged_attempts) AS counted \
             GROUP BY kind, outcome",
        )
        .fetch_all(&self.reader)
        .await?;
        Ok(Census {
            jobs: jobs
                .into_iter()
                .map(|(kind, state, n)| (kind, state.0, n.unsigned_abs()))
                .collect(),
            tasks: tasks
                .into_iter()
                .map(|(kind, state, n)| (kind, state.0, n.unsigned_abs()))
                .collect(),
            attempts: attempts
                .into_iter()
                .map(|(kind, outcome, n)| (kind, outcome.map(|row| row.0), n.unsigned_abs()))
                .collect(),
        })
    }
}
