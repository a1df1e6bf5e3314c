//! The ways in which an attempt ends without success.

use std::time::Duration;

use store::{Fence, JobId, Retry, Store, StoreError};

use crate::attempt_log::AttemptLog;
use crate::error::{TaskError, WorkerError};
use crate::stop::StopReason;

/// A task that this worker has claimed.
pub(crate) struct HeldTask<'a> {
    pub store: &'a Store,
    pub fence: Fence,
    pub job: JobId,
    pub label: String,
    pub time_limit: Option<Duration>,
    pub log: &'a AttemptLog,
}

/// How long an absent database may keep a process alive whose work does not end. After that,
/// another process takes the task back.
const END_WITHIN: Duration = Duration::from_secs(5);

/// The end of the message of a task that found no room for its results.
const WAITS: &str = "it waits for room and is tried again; this attempt is not counted";

impl HeldTask<'_> {
    /// Ends the attempt according to the result of its work.
    pub async fn end(&self, done: &Result<(), TaskError>, told: Option<StopReason>) {
        let (job, task) = (self.job, &self.label);
        let error = match done {
            // The work itself has ended the attempt.
            Ok(()) => return,
            Err(error) => error,
        };
        let lost = matches!(error, TaskError::Store(StoreError::LeaseLost { .. }));
        if lost || told == Some(StopReason::LeaseLost) {
            tracing::warn!(%job, task, "lost its lease; what it did does not count");
            return;
        }
        tracing::warn!(%job, task, error = spec::causes(error), "not done");
        self.send_log().await;
        let ended = match error {
            TaskError::Stopped => self.end_stopped(told.unwrap_or(StopReason::Shutdown), "").await,
            // The task is not at fault.
            TaskError::Store(error) if error.is_database_away() => {
                self.store.release(self.fence).await
            }
            error if error.is_without_room() => {
                let reason = format!("{}; {WAITS}", spec::causes(error));
                self.store.defer(self.fence, &reason).await
            }
            error => self.store.fail(self.fence, &spec::causes(error), error.retry()).await,
        };
        self.report(ended);
    }

    /// Ends the attempt while its work still runs. Returns why this process must end.
    pub async fn end_unstoppable(&self, told: StopReason) -> WorkerError {
        let error =
            WorkerError::Unstoppable { job: self.job, task: self.label.clone(), reason: told };
        tracing::error!("{error}");
        let late = format!(", and did not end within {} s", told.within().as_secs());
        let ending = async {
            self.send_log().await;
            self.end_stopped(told, &late).await
        };
        match tokio::time::timeout(END_WITHIN, ending).await {
            Ok(ended) => self.report(ended),
            Err(_) => tracing::error!("the database does not answer; the task is left to others"),
        }
        error
    }

    /// Ends an attempt that was told to end. `late` completes the reason if it took too long.
    async fn end_stopped(&self, told: StopReason, late: &str) -> Result<(), StoreError> {
        match told {
            StopReason::LeaseLost => Ok(()),
            StopReason::Cancelled => self.store.stopped(self.fence).await,
            StopReason::TimeLimit => {
                let limit = self.time_limit.unwrap_or_default().as_secs();
                let error = format!(
                    "it took longer than its time limit of {limit} s{late}: execution.time_limit_s, or the server's for \
                     jobs of its kind"
                );
                self.store.fail(self.fence, &error, Retry::Never).await
            }
            StopReason::Shutdown => self.store.release(self.fence).await,
        }
    }

    async fn send_log(&self) {
        if let Err(error) = self.log.send(self.store, self.fence).await {
            tracing::warn!(error = spec::causes(&error), "cannot write the end of the log");
        }
    }

    fn report(&self, ended: Result<(), StoreError>) {
        if let Err(error) = ended {
            let (job, error) = (self.job, spec::causes(&error));
            tracing::error!(%job, task = self.label, error, "cannot end the task");
        }
    }
}
