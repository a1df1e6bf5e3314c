//! Runs: the records of trainings and evaluations. A job that leaves a run has it from its
//! submission on.

use serde_json::Value;
use spec::Digest;
use wire::JobState;

use crate::boxed;
use crate::database::sql;
use crate::trash::refuse_deleted;
use crate::{Deletion, JobId, Listing, Page, RunId, Store, StoreError, Timestamp};

#[derive(Clone, Debug)]
pub struct Run {
    pub id: RunId,
    pub job: JobId,
    /// The job's kind.
    pub kind: String,
    /// The name that users gave it, or the name of its job.
    pub name: String,
    pub note: Option<String>,
    /// Sorted.
    pub tags: Vec<String>,
    /// Tags of the job, sorted.
    pub job_tags: Vec<String>,
    pub digest: Digest,
    pub spec: Value,
    pub state: JobState,
    pub error: Option<String>,
    pub created_at: Timestamp,
    pub started_at: Option<Timestamp>,
    pub finished_at: Option<Timestamp>,
    pub deletion: Option<Deletion>,
}

impl Store {
    /// # Errors
    /// When there is no such run, or it was deleted.
    #[boxed]
    pub async fn run(&self, id: RunId) -> Result<Run, StoreError> {
        let found = sql!(self.database(), "reading a run", run(id))?
            .ok_or_else(|| StoreError::not_found("run", id.to_string()))?;
        refuse_deleted(id, found.deletion.as_ref())?;
        Ok(found)
    }

    /// Runs, newest first; of every kind if `kind` is `None`.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn runs(&self, kind: Option<&str>, page: Page) -> Result<Vec<Run>, StoreError> {
        let kind = kind.map(str::to_owned);
        Ok(self.list_runs(&Listing { kind, ..page.into() }).await?.items)
    }

    /// The run of a job.
    ///
    /// # Errors
    /// When the job leaves no run, or the run was deleted.
    #[boxed]
    pub async fn run_of_job(&self, job: JobId) -> Result<Run, StoreError> {
        let found = sql!(self.database(), "reading a run", run_of_job(job))?
            .ok_or_else(|| StoreError::not_found("run of job", job.to_string()))?;
        refuse_deleted(found.id, found.deletion.as_ref())?;
        Ok(found)
    }
}
