//! Looking up tasks; see `leases` for how they are worked on.
//!
//! A job may have 10 000 tasks, and each may have a large result. So lists read pages, or leave
//! results out.

use serde_json::Value;
use wire::TaskState;

use crate::boxed;
use crate::database::sql;
use crate::{Epoch, JobId, Page, Progress, Store, StoreError, TaskId, Timestamp};

#[derive(Clone, Debug)]
pub struct Task {
    pub id: TaskId,
    pub job: JobId,
    pub stage: u32,
    pub ordinal: u32,
    pub label: String,
    pub payload: Value,
    pub state: TaskState,
    /// Number of claims since it last made progress, see [`Store::commit_checkpoint`].
    pub attempt: u32,
    pub max_attempts: u32,
    pub epoch: Epoch,
    /// The worker that has it, or had it last.
    pub worker: Option<String>,
    pub lease_until: Option<Timestamp>,
    pub cancel_requested: bool,
    pub progress: Progress,
    /// Amount of work in the job's unit.
    pub total: u64,
    /// The result with which it was completed.
    pub result: Option<Value>,
    /// The error of the last attempt that failed.
    pub error: Option<String>,
    pub started_at: Option<Timestamp>,
    pub finished_at: Option<Timestamp>,
}

/// A task without its payload and its result, which may both be large.
#[derive(Clone, Debug)]
pub struct TaskOverview {
    pub id: TaskId,
    pub job: JobId,
    pub label: String,
    pub state: TaskState,
    /// See [`Task`].
    pub attempt: u32,
    /// The worker that has it, or had it last.
    pub worker: Option<String>,
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
    pub job: JobId,
    /// `None` for tasks without a result, or without the field.
    pub value: Option<String>,
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
        let tasks = sql!(self.database(), READING, tasks(job))?;
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
        sql!(self.database(), READING, task_page(job, page))
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
        sql!(self.database(), READING, first_tasks(job, limit))
    }

    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn count_tasks(&self, job: JobId) -> Result<u64, StoreError> {
        sql!(self.database(), "counting a job's tasks", count_tasks(job))
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
        sql!(self.database(), READING, tasks_of_stage(jobs, stage))
    }

    /// The result of the only task of each job's last stage. Jobs with several tasks in that stage
    /// are left out.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn sole_results(&self, jobs: &[JobId]) -> Result<Vec<(JobId, Value)>, StoreError> {
        sql!(self.database(), "reading the results of jobs", sole_results(jobs))
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
        sql!(self.database(), "counting the results of tasks", result_tallies(jobs, field))
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
        sql!(self.database(), READING, results_unlike(job, field, value, limit))
    }

    /// # Errors
    /// When there is no such task.
    #[boxed]
    pub async fn task(&self, id: TaskId) -> Result<Task, StoreError> {
        sql!(self.database(), "reading a task", task(id))?
            .ok_or_else(|| StoreError::not_found("task", id.to_string()))
    }
}

const READING: &str = "reading a job's tasks";
