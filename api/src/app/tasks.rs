//! Tasks of jobs. They are read page by page or without their results, because a job may have 10
//! 000 tasks.

use std::collections::BTreeMap;

use serde_json::Value;
use store::{JobId, ShardSummary, TaskId, TaskOverview, TaskPage};
use wire::{Progress, Task, Tasks};

use crate::app::App;
use crate::app::jobs::text;
use crate::app::paging::TaskPaging;
use crate::error::ApiError;

/// The first tasks of a job.
pub struct FirstTasks {
    pub tasks: Vec<TaskOverview>,
    /// The number of all tasks.
    pub all: u64,
}

impl App {
    /// # Errors
    /// When the job does not exist, or the page should begin after a task of another job.
    pub(crate) async fn tasks(&self, job: i64, paging: TaskPaging) -> Result<Tasks, ApiError> {
        let unit = self.store.job(JobId(job)).await?.progress.unit;
        let page = TaskPage { after: paging.after.map(TaskId), limit: paging.limit };
        let rows = self.store.task_page(JobId(job), page).await?;
        if let Some(after) = paging.after.filter(|_| rows.is_empty()) {
            self.check_task(job, after).await?;
        }
        let next = paging.next(rows.len(), rows.last().map(|row| row.id.0));
        Ok(Tasks { tasks: rows.into_iter().map(|row| task(row, &unit)).collect(), next })
    }

    async fn check_task(&self, job: i64, id: i64) -> Result<(), ApiError> {
        match self.store.task(TaskId(id)).await {
            Ok(task) if task.job.0 == job => Ok(()),
            Ok(_) | Err(store::StoreError::NotFound { .. }) => {
                Err(ApiError::parameter("after", id, format!("the id of a task of job {job}")))
            }
            Err(error) => Err(error.into()),
        }
    }

    pub(crate) async fn first_tasks(&self, job: i64, limit: u32) -> Result<FirstTasks, ApiError> {
        let tasks = self.store.first_tasks(JobId(job), limit).await?;
        Ok(FirstTasks { tasks, all: self.store.count_tasks(JobId(job)).await? })
    }

    /// The result of the only task in each job's last stage, by job. Jobs with several tasks in
    /// that stage are left out.
    pub(crate) async fn sole_results(
        &self,
        jobs: &[i64],
    ) -> Result<BTreeMap<i64, Value>, ApiError> {
        let jobs: Vec<JobId> = jobs.iter().copied().map(JobId).collect();
        let results = self.store.sole_results(&jobs).await?;
        Ok(results.into_iter().map(|(job, result)| (job.0, result)).collect())
    }
}

fn task(row: store::Task, unit: &str) -> Task {
    Task {
        id: row.id.0,
        stage: row.stage,
        ordinal: row.ordinal,
        label: row.label,
        state: row.state,
        attempt: row.attempt,
        max_attempts: row.max_attempts,
        epoch: row.epoch.0,
        worker: row.worker,
        lease_until: text(row.lease_until),
        error: row.error,
        progress: progress(row.progress, row.total, unit),
        result: row.result.and_then(without_details),
        started_at: text(row.started_at),
        finished_at: text(row.finished_at),
    }
}

/// The progress of a task with `total` units of work.
pub fn progress(row: store::Progress, total: u64, unit: &str) -> Progress {
    Progress {
        done: row.done,
        total,
        unit: unit.to_owned(),
        rate_per_second: row.rate_per_second,
        message: row.message,
    }
}

/// The result without details that are elsewhere. The dataset's summary has the ranges and spectra
/// of all shards, and the evaluation's report has the errors of each joint.
fn without_details(result: Value) -> Option<Value> {
    let Value::Object(mut entries) = result else { return Some(result) };
    entries.remove(ShardSummary::KEY);
    if let Some(Value::Array(predictors)) = entries.get_mut("predictors") {
        for errors in predictors.iter_mut().filter_map(Value::as_object_mut) {
            errors.remove("step_squares_deg2");
        }
    }
    (!entries.is_empty()).then_some(Value::Object(entries))
}
