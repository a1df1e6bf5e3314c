//! Pipelines: jobs whose members are jobs. A pipeline's state follows from its members' states.

use std::collections::BTreeSet;

use wire::JobState;

use crate::database::Transaction;
use crate::database::column::json;
use crate::database::query::{Row, from_row, sql};
use crate::queue::rules::cancellation::Candidate;
use crate::queue::rules::job::is_unsuccessful;
use crate::queue::rules::pipeline::{MemberStanding, culprit, settled};
use crate::{JobId, JobProgress, Store, StoreError, boxed};

/// A member of a pipeline.
#[derive(Clone, Debug)]
pub struct Member {
    /// The pipeline that has the member.
    pub pipeline: JobId,
    /// Its name in the pipeline.
    pub name: String,
    /// The job that it is.
    pub job: JobId,
    /// The store does not interpret it.
    pub kind: String,
    /// Where its job stands.
    pub state: JobState,
    /// Why it failed or was cancelled.
    pub error: Option<String>,
    /// How much of its work is done.
    pub progress: JobProgress,
    /// Whether the job existed before the pipeline was submitted.
    pub reused: bool,
}

/// A pipeline that has a job as a member.
#[derive(Clone, Debug)]
pub struct Membership {
    /// The job.
    pub job: JobId,
    /// The pipeline.
    pub pipeline: JobId,
    /// The pipeline's name.
    pub pipeline_name: String,
    /// The job's name in the pipeline.
    pub name: String,
}

/// A member, with what its pipeline needs to know.
#[derive(Clone, Debug)]
pub(crate) struct MemberRow {
    pub name: String,
    pub job: JobId,
    pub state: JobState,
    pub cancel_requested: bool,
    pub error: Option<String>,
}

impl Store {
    /// Members grouped by pipeline, in the order of submission. Each comes after the members that
    /// it needs. A job that is not a pipeline has none.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn members(&self, pipelines: &[JobId]) -> Result<Vec<Member>, StoreError> {
        let mut reading = self.read("reading the members of pipelines");
        let mut members: Vec<Member> =
            sql("SELECT member.pipeline, member.name, member.reused, member.job, job.kind, \
             job.state, job.error, job.unit FROM pipeline_member AS member JOIN job \
             ON job.id = member.job WHERE member.pipeline IN {ids $1} \
             ORDER BY member.pipeline, member.ordinal")
            .bind(json(&pipelines))
            .all(&mut reading)
            .await?;
        let jobs: BTreeSet<JobId> = members.iter().map(|member| member.job).collect();
        let progress = reading.progress(&jobs.into_iter().collect::<Vec<_>>()).await?;
        for member in &mut members {
            if let Some(found) = progress.get(&member.job) {
                let unit = std::mem::take(&mut member.progress.unit);
                member.progress = JobProgress { unit, ..found.clone() };
            }
        }
        Ok(members)
    }

    /// The pipelines that have these jobs as members and are not in the trash, sorted by job, the
    /// newest pipeline of each first.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn memberships(&self, jobs: &[JobId]) -> Result<Vec<Membership>, StoreError> {
        sql("SELECT member.job, member.pipeline, member.name, \
             COALESCE(pipeline.given_name, pipeline.name) AS pipeline_name \
             FROM pipeline_member AS member JOIN job AS pipeline ON pipeline.id = member.pipeline \
             WHERE member.job IN {ids $1} AND pipeline.deleted_at IS NULL \
             ORDER BY member.job, member.pipeline DESC, member.ordinal")
        .bind(json(&jobs))
        .all(&mut self.read("reading the pipelines of jobs"))
        .await
    }
}

/// Updates all pipelines that `job` belongs to.
pub(crate) async fn settle_pipelines_of(
    tx: &mut Transaction,
    job: JobId,
) -> Result<(), StoreError> {
    for pipeline in tx.pipelines_of(job).await? {
        settle(tx, pipeline).await?;
    }
    Ok(())
}

/// Derives a pipeline's state from the states of its members.
pub(crate) async fn settle(tx: &mut Transaction, pipeline: JobId) -> Result<(), StoreError> {
    let (state, cancel_requested) = tx.pipeline(pipeline).await?;
    let members = tx.member_rows(pipeline).await?;
    let standings: Vec<MemberStanding> = members.iter().map(MemberRow::standing).collect();
    let next = settled(state, cancel_requested, &standings);
    if next == state {
        return Ok(());
    }
    let blames_member = is_unsuccessful(next) && !cancel_requested;
    let error = culprit(&standings).filter(|_| blames_member).map(|i| members[i].reason());
    tx.set_pipeline(pipeline, next, error.as_deref()).await
}

impl MemberRow {
    fn standing(&self) -> MemberStanding {
        MemberStanding { state: self.state, cancel_requested: self.cancel_requested }
    }

    /// Why its pipeline did not succeed.
    fn reason(&self) -> String {
        let end = if self.state == JobState::Failed { "failed" } else { "was cancelled" };
        let error = self.error.as_ref().map(|error| format!(": {error}")).unwrap_or_default();
        format!("{} (job {}) {end}{error}", self.name, self.job)
    }
}

impl Transaction {
    pub async fn insert_member(
        &mut self,
        pipeline: JobId,
        ordinal: u32,
        name: &str,
        job: JobId,
        reused: bool,
    ) -> Result<(), StoreError> {
        sql("INSERT INTO pipeline_member (pipeline, name, ordinal, job, reused) \
             VALUES ($1, $2, $3, $4, $5)")
        .bind(pipeline)
        .bind(name)
        .bind(ordinal)
        .bind(job)
        .bind(reused)
        .run(self)
        .await
    }

    pub async fn pipelines_of(&mut self, job: JobId) -> Result<Vec<JobId>, StoreError> {
        sql("SELECT DISTINCT pipeline FROM pipeline_member WHERE job = $1")
            .bind(job)
            .all(self)
            .await
    }

    pub async fn has_members(&mut self, job: JobId) -> Result<bool, StoreError> {
        sql("SELECT EXISTS (SELECT 1 FROM pipeline_member WHERE pipeline = $1)")
            .bind(job)
            .one(self)
            .await
    }

    /// The state of a pipeline, and whether its cancellation was requested.
    pub async fn pipeline(&mut self, pipeline: JobId) -> Result<(JobState, bool), StoreError> {
        let (state, cancel_requested) =
            sql("SELECT state, cancel_requested FROM job WHERE id = $1")
                .bind(pipeline)
                .one(self)
                .await?;
        Ok((state, cancel_requested))
    }

    /// In the order of submission.
    pub async fn member_rows(&mut self, pipeline: JobId) -> Result<Vec<MemberRow>, StoreError> {
        sql("SELECT member.name, job.id AS job, job.state, job.cancel_requested, job.error \
             FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline = $1 ORDER BY member.ordinal")
        .bind(pipeline)
        .all(self)
        .await
    }

    /// Sets the state of a pipeline. Its times follow from the state.
    pub async fn set_pipeline(
        &mut self,
        pipeline: JobId,
        state: JobState,
        error: Option<&str>,
    ) -> Result<(), StoreError> {
        sql("UPDATE job SET state = $1, error = $2, started_at = COALESCE(started_at, {now}), \
             finished_at = CASE WHEN $1 = 'running' THEN NULL ELSE {now} END WHERE id = $3")
        .bind(state)
        .bind(error)
        .bind(pipeline)
        .run(self)
        .await
    }

    /// The members of a pipeline, without the jobs that wait for them.
    pub async fn candidates(&mut self, pipeline: JobId) -> Result<Vec<Candidate>, StoreError> {
        let rows = sql(
            "SELECT job.id, job.state, job.asked_alone, EXISTS (SELECT 1 \
                 FROM pipeline_member AS other JOIN job AS pipeline ON pipeline.id = other.pipeline \
                 WHERE other.job = job.id AND NOT pipeline.cancel_requested \
                 AND pipeline.state IN ('waiting', 'queued', 'running')) AS is_shared \
             FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline = $1",
        )
        .bind(pipeline)
        .rows(self)
        .await?;
        let candidate = |row: &Row| {
            Ok(Candidate {
                job: row.get("id")?,
                state: row.get("state")?,
                asked_alone: row.get("asked_alone")?,
                is_shared: row.get("is_shared")?,
                needed_by: Vec::new(),
            })
        };
        rows.iter().map(candidate).collect()
    }
}

// Reads only the unit of the progress.
from_row!(Member {
    pipeline, name, job, kind, state, error, reused,
    ..row =>
    progress: JobProgress { unit: row.get("unit")?, ..JobProgress::default() },
});

from_row!(Membership { job, pipeline, pipeline_name, name });

from_row!(MemberRow { name, job, state, cancel_requested, error });
