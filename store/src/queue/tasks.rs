//! Looking up tasks; see `leases` for how they are worked on.
//!
//! A job may have 10 000 tasks, and each may have a large result. So lists read pages, or leave
//! results out.

use serde_json::Value;
use wire::TaskState;

use crate::database::column::json;
use crate::database::query::{from_row, sql};
use crate::{JobId, Page, Progress, Store, StoreError, Task, TaskId, boxed};

/// The columns of [`TaskOverview`].
macro_rules! select_overview {
    ($($rest:expr),+ $(,)?) => {
        concat!(
            "SELECT id, job, label, state, attempt, worker, done, total, rate, message, error \
             FROM task ",
            $($rest),+
        )
    };
}

/// A task without its payload and its result, which may both be large.
#[derive(Clone, Debug)]
pub struct TaskOverview {
    /// Its id.
    pub id: TaskId,
    /// The job that it belongs to.
    pub job: JobId,
    /// A name for people, such as `shard 3`.
    pub label: String,
    /// Where it stands between its submission and its end.
    pub state: TaskState,
    /// See [`Task`].
    pub attempt: u32,
    /// The worker that has it, or had it last.
    pub worker: Option<String>,
    /// How much of its work is done.
    pub progress: Progress,
    /// Amount of work in the job's unit.
    pub total: u64,
    /// The error of the last attempt that failed.
    pub error: Option<String>,
}

/// A page of a job's tasks, in the order in which they run.
#[derive(Clone, Copy, Debug)]
pub struct TaskPage {
    /// Only tasks that run after this one. Pass the last task of the page before.
    pub after: Option<TaskId>,
    /// Number of tasks, 500 at most.
    pub limit: u32,
}

impl TaskPage {
    pub(crate) fn limit(self) -> i64 {
        i64::from(self.limit.min(Page::MAX_LIMIT))
    }
}

/// The number of tasks of a job that have the same value in a field of their results.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResultTally {
    /// The job that the tasks belong to.
    pub job: JobId,
    /// `None` for tasks without a result, or without the field.
    pub value: Option<String>,
    /// Number of tasks with a result.
    pub tasks: u64,
}

impl Store {
    /// All tasks of a job with their results, in the order in which they run. The last task of a
    /// job reads them.
    ///
    /// # Errors
    /// When there is no such job.
    #[boxed]
    pub async fn tasks(&self, job: JobId) -> Result<Vec<Task>, StoreError> {
        let tasks = self.read(READING).tasks(job).await?;
        if tasks.is_empty() {
            // A pipeline has no tasks either, and that is no error.
            self.job(job).await?;
        }
        Ok(tasks)
    }

    /// A page of tasks, in the order in which they run. It is empty after a task of another job.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn task_page(&self, job: JobId, page: TaskPage) -> Result<Vec<Task>, StoreError> {
        let query = match page.after {
            None => sql("SELECT * FROM task WHERE job = $1 ORDER BY stage, ordinal LIMIT $2")
                .bind(job)
                .bind(page.limit()),
            Some(after) => sql("SELECT * FROM task WHERE job = $1 AND (stage, ordinal) > \
                 (SELECT stage, ordinal FROM task WHERE job = $1 AND id = $2) \
                 ORDER BY stage, ordinal LIMIT $3")
            .bind(job)
            .bind(after)
            .bind(page.limit()),
        };
        query.all(&mut self.read(READING)).await
    }

    /// The first `limit` tasks, in the order in which they run.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn first_tasks(
        &self,
        job: JobId,
        limit: u32,
    ) -> Result<Vec<TaskOverview>, StoreError> {
        sql(select_overview!("WHERE job = $1 ORDER BY stage, ordinal LIMIT $2"))
            .bind(job)
            .bind(limit)
            .all(&mut self.read(READING))
            .await
    }

    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn count_tasks(&self, job: JobId) -> Result<u64, StoreError> {
        let tasks: i64 = sql("SELECT COUNT(*) FROM task WHERE job = $1")
            .bind(job)
            .one(&mut self.read("counting a job's tasks"))
            .await?;
        Ok(tasks.unsigned_abs())
    }

    /// The tasks of one stage, for each of `jobs`.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn tasks_of_stage(
        &self,
        jobs: &[JobId],
        stage: u32,
    ) -> Result<Vec<TaskOverview>, StoreError> {
        sql(select_overview!("WHERE job IN ", "{ids $1}", " AND stage = $2 ORDER BY job, ordinal"))
            .bind(json(&jobs))
            .bind(stage)
            .all(&mut self.read(READING))
            .await
    }

    /// The result of the only task of each job's last stage. Jobs with several tasks in that stage
    /// are left out.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn sole_results(&self, jobs: &[JobId]) -> Result<Vec<(JobId, Value)>, StoreError> {
        let rows = sql(
            "SELECT job, result FROM task AS last WHERE job IN {ids $1} AND result IS NOT NULL \
             AND NOT EXISTS (SELECT 1 FROM task AS other WHERE other.job = last.job \
             AND other.stage >= last.stage AND (other.stage, other.ordinal) <> (last.stage, \
             last.ordinal))",
        )
        .bind(json(&jobs))
        .rows(&mut self.read("reading the results of jobs"))
        .await?;
        rows.iter().map(|row| Ok((row.get("job")?, row.get("result")?))).collect()
    }

    /// Counts the tasks of each job by the value of a field in their results.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn result_tallies(
        &self,
        jobs: &[JobId],
        field: &str,
    ) -> Result<Vec<ResultTally>, StoreError> {
        let rows: Vec<(JobId, Option<String>, i64)> = sql(
            "SELECT job, {field result $1} AS found, COUNT(*) FROM task WHERE job IN {ids $2} \
             GROUP BY job, found",
        )
        .bind(field)
        .bind(json(&jobs))
        .all(&mut self.read("counting the results of tasks"))
        .await?;
        let tally = |(job, value, tasks): (JobId, Option<String>, i64)| ResultTally {
            job,
            value,
            tasks: tasks.unsigned_abs(),
        };
        Ok(rows.into_iter().map(tally).collect())
    }

    /// Label and result of the first `limit` tasks whose results have a value other than `value` in
    /// a field.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn results_unlike(
        &self,
        job: JobId,
        field: &str,
        value: &str,
        limit: u32,
    ) -> Result<Vec<(String, Value)>, StoreError> {
        let rows =
            sql("SELECT label, result FROM task WHERE job = $1 AND {field result $2} <> $3 \
             ORDER BY stage, ordinal LIMIT $4")
            .bind(job)
            .bind(field)
            .bind(value)
            .bind(limit)
            .rows(&mut self.read(READING))
            .await?;
        rows.iter().map(|row| Ok((row.get("label")?, row.get("result")?))).collect()
    }

    /// # Errors
    /// When there is no such task.
    #[boxed]
    pub async fn task(&self, id: TaskId) -> Result<Task, StoreError> {
        self.read("reading a task")
            .task(id)
            .await?
            .ok_or_else(|| StoreError::not_found("task", id.to_string()))
    }
}

const READING: &str = "reading a job's tasks";

from_row!(TaskOverview {
    id, job, label, state, attempt, worker, total, error,
    ..row =>
    progress: Progress {
        done: row.get("done")?,
        rate_per_second: row.get("rate")?,
        message: row.get("message")?,
    },
});
