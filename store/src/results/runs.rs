//! Runs: the records of trainings and evaluations. A job that leaves a run has it from its
//! submission on.

use serde_json::Value;
use spec::Digest;
use wire::JobState;

use crate::database::column::json;
use crate::database::query::{from_row, sql};
use crate::database::rows::{deletion, tags};
use crate::database::{Reading, Transaction};
use crate::lists::listing::{LISTING, Listed};
use crate::trash::refuse_deleted;
use crate::{Deletion, ItemKind, JobId, Listing, Page, RunId, Store, StoreError, Timestamp, boxed};

macro_rules! select_run {
    ($($rest:expr),+ $(,)?) => {
        concat!(
            "SELECT run.id, run.job, run.created_at, run.note, run.deleted_at, run.purge_at, run.purged_at, \
             run.deletion_reason, job.kind, job.digest, job.spec, \
             COALESCE(run.given_name, job.given_name, job.name) AS name, \
             job.state, job.error, job.started_at, job.finished_at, ",
            "{tags run_tag run run.id}",
            " AS own_tags, ",
            "{tags job_tag job run.job}",
            " AS job_tags FROM run JOIN job ON job.id = run.job ",
            $($rest),+
        )
    };
}

/// The record of a training or an evaluation, with where its job stands.
#[derive(Clone, Debug)]
pub struct Run {
    /// Its id.
    pub id: RunId,
    /// The job that left it.
    pub job: JobId,
    /// The job's kind.
    pub kind: String,
    /// The name that users gave it, or the name of its job.
    pub name: String,
    /// A note in Markdown.
    pub note: Option<String>,
    /// Sorted.
    pub tags: Vec<String>,
    /// Tags of the job, sorted.
    pub job_tags: Vec<String>,
    /// The digest of its job.
    pub digest: Digest,
    /// The spec of its job.
    pub spec: Value,
    /// The state of its job.
    pub state: JobState,
    /// Why its job failed or was cancelled.
    pub error: Option<String>,
    /// When its job was submitted.
    pub created_at: Timestamp,
    /// When a worker first claimed a task of its job.
    pub started_at: Option<Timestamp>,
    /// When its job reached a final state.
    pub finished_at: Option<Timestamp>,
    /// When it was moved to the trash; `None` if it was not.
    pub deletion: Option<Deletion>,
}

/// The parts of a run that a search of all runs reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunSummary {
    /// Its id.
    pub id: RunId,
    /// The name that users gave it, or the name of its job.
    pub name: String,
    /// The state of its job.
    pub state: JobState,
    /// When its job was submitted.
    pub created_at: Timestamp,
    /// When a worker first claimed a task of its job.
    pub started_at: Option<Timestamp>,
    /// When its job reached a final state.
    pub finished_at: Option<Timestamp>,
}

impl From<&Run> for RunSummary {
    fn from(run: &Run) -> Self {
        let Run { id, name, state, created_at, started_at, finished_at, .. } = run;
        Self {
            id: *id,
            name: name.clone(),
            state: *state,
            created_at: *created_at,
            started_at: *started_at,
            finished_at: *finished_at,
        }
    }
}

impl Store {
    /// All runs that were not deleted, newest first.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn run_summaries(&self) -> Result<Vec<RunSummary>, StoreError> {
        sql(
            "SELECT run.id, COALESCE(run.given_name, job.given_name, job.name) AS name, job.state, \
             run.created_at, job.started_at, job.finished_at FROM run JOIN job ON job.id = run.job \
             WHERE run.deleted_at IS NULL ORDER BY run.id DESC",
        )
        .all(&mut self.read(LISTING))
        .await
    }

    /// The runs with these ids, in no order. Those that do not exist are left out.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn runs_with_ids(&self, ids: &[RunId]) -> Result<Vec<Run>, StoreError> {
        self.read(LISTING).runs_by_id(ids).await
    }

    /// A page of the list of runs.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn list_runs(&self, listing: &Listing) -> Result<Listed<Run>, StoreError> {
        let found = self.found(ItemKind::Run, listing).await?;
        let ids: Vec<RunId> = found.ids.iter().copied().map(RunId).collect();
        let rows = self.read(LISTING).runs_by_id(&ids).await?;
        Ok(found.with(rows, |run| run.id.0))
    }

    /// # Errors
    /// When there is no such run, or it was deleted.
    #[boxed]
    pub async fn run(&self, id: RunId) -> Result<Run, StoreError> {
        let found = self
            .read("reading a run")
            .run(id)
            .await?
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
        let found = self
            .read("reading a run")
            .run_of_job(job)
            .await?
            .ok_or_else(|| StoreError::not_found("run of job", job.to_string()))?;
        refuse_deleted(found.id, found.deletion.as_ref())?;
        Ok(found)
    }
}

impl Reading<'_> {
    pub async fn run(&mut self, id: RunId) -> Result<Option<Run>, StoreError> {
        sql(select_run!("WHERE run.id = $1")).bind(id).optional(self).await
    }

    pub async fn runs_by_id(&mut self, ids: &[RunId]) -> Result<Vec<Run>, StoreError> {
        sql(select_run!("WHERE run.id IN ", "{ids $1}")).bind(json(&ids)).all(self).await
    }

    pub async fn run_of_job(&mut self, job: JobId) -> Result<Option<Run>, StoreError> {
        sql(select_run!("WHERE run.job = $1")).bind(job).optional(self).await
    }
}

impl Transaction {
    pub async fn insert_run(&mut self, job: JobId) -> Result<(), StoreError> {
        sql("INSERT INTO run (job, created_at) VALUES ($1, {now})").bind(job).run(self).await
    }

    pub async fn run_id(&mut self, job: JobId) -> Result<Option<RunId>, StoreError> {
        sql("SELECT id FROM run WHERE job = $1").bind(job).optional(self).await
    }
}

from_row!(RunSummary { id, name, state, created_at, started_at, finished_at });

from_row!(Run {
    id, job, kind, name, note, digest, spec, state, error, created_at, started_at, finished_at,
    ..row =>
    tags: tags(row, "own_tags")?,
    job_tags: tags(row, "job_tags")?,
    deletion: deletion(row)?,
});
