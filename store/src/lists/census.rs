//! Counts of jobs, tasks and attempts, for the server's metrics.

use wire::{AttemptOutcome, JobState, TaskState};

use crate::database::query::sql;
use crate::{Store, StoreError, boxed};

/// Counts by kind of job. Counts of zero are left out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Number of jobs of each kind in each state.
    pub jobs: Vec<(String, JobState, u64)>,
    /// Number of tasks of each kind of job in each state.
    pub tasks: Vec<(String, TaskState, u64)>,
    /// Those of jobs that were deleted for good included; without an outcome, those that go on.
    pub attempts: Vec<(String, Option<AttemptOutcome>, u64)>,
}

impl Store {
    /// Counts all jobs, tasks and attempts. The time grows with their number: about 0.2 s for a
    /// million.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn census(&self) -> Result<Census, StoreError> {
        let mut reading = self.read("counting jobs, tasks and attempts");
        let jobs: Vec<(String, JobState, i64)> =
            sql("SELECT kind, state, COUNT(*) FROM job GROUP BY kind, state")
                .all(&mut reading)
                .await?;
        let tasks: Vec<(String, TaskState, i64)> =
            sql("SELECT job.kind, task.state, COUNT(*) FROM task JOIN job ON job.id = task.job \
             GROUP BY job.kind, task.state")
            .all(&mut reading)
            .await?;
        let attempts: Vec<(String, Option<AttemptOutcome>, i64)> =
            sql("SELECT kind, outcome, CAST(SUM(number) AS BIGINT) FROM \
             (SELECT job.kind, attempt.outcome, COUNT(*) AS number FROM attempt \
              JOIN job ON job.id = attempt.job GROUP BY job.kind, attempt.outcome \
              UNION ALL SELECT kind, outcome, number FROM purged_attempts) AS counted \
             GROUP BY kind, outcome")
            .all(&mut reading)
            .await?;
        Ok(Census {
            jobs: jobs
                .into_iter()
                .map(|(kind, state, n)| (kind, state, n.unsigned_abs()))
                .collect(),
            tasks: tasks
                .into_iter()
                .map(|(kind, state, n)| (kind, state, n.unsigned_abs()))
                .collect(),
            attempts: attempts
                .into_iter()
                .map(|(kind, outcome, n)| (kind, outcome, n.unsigned_abs()))
                .collect(),
        })
    }
}
