//! Pipelines: jobs whose members are jobs, and whose state is theirs.

use sqlx::sqlite::SqliteRow;
use sqlx::types::Text;
use sqlx::{FromRow, Row, SqliteConnection};

use crate::clock::now;
use crate::{JobId, JobState, Store, StoreError};

#[derive(Clone, Debug)]
pub struct Member {
    pub name: String,
    pub job: JobId,
    pub kind: String,
    pub state: JobState,
    pub error: Option<String>,
    /// Whether the job was there before the pipeline was submitted.
    pub reused: bool,
}

impl Store {
    /// In the order of submission, each after those it needs; empty unless `pipeline` is one.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn members(&self, pipeline: JobId) -> Result<Vec<Member>, StoreError> {
        sqlx::query_as(
            "SELECT member.name, member.job, member.reused, job.kind, job.state, job.error \
             FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline = ? ORDER BY member.ordinal",
        )
        .bind(pipeline)
        .fetch_all(self.database().reader())
        .await
        .map_err(StoreError::database("reading a pipeline's members"))
    }
}

/// Brings all pipelines that `job` is in up to date with it.
pub(crate) async fn settle_those_of(
    conn: &mut SqliteConnection,
    job: JobId,
) -> Result<(), sqlx::Error> {
    let pipelines: Vec<JobId> =
        sqlx::query_scalar("SELECT DISTINCT pipeline FROM pipeline_member WHERE job = ?")
            .bind(job)
            .fetch_all(&mut *conn)
            .await?;
    for pipeline in pipelines {
        settle(conn, pipeline).await?;
    }
    Ok(())
}

#[derive(FromRow)]
struct Standing {
    state: Text<JobState>,
    cancel_requested: bool,
    /// Members that are yet to end. Those that a cancelled pipeline leaves to others do not count.
    open: i64,
    started: i64,
    unsuccessful: i64,
    /// The first member that failed, or else was cancelled.
    error: Option<String>,
    failed: i64,
}

/// Derives a pipeline's state from its members'.
pub(crate) async fn settle(
    conn: &mut SqliteConnection,
    pipeline: JobId,
) -> Result<(), sqlx::Error> {
    let standing: Standing = sqlx::query_as(
        "SELECT pipeline.state, pipeline.cancel_requested, \
         SUM(job.state IN ('waiting', 'queued', 'running') \
             AND (NOT pipeline.cancel_requested OR job.cancel_requested)) AS open, \
         SUM(job.state NOT IN ('waiting', 'queued')) AS started, \
         SUM(job.state <> 'succeeded') AS unsuccessful, \
         SUM(job.state = 'failed') AS failed, \
         (SELECT member.name || ' (job ' || job.id || ') ' || \
             CASE WHEN job.state = 'failed' THEN 'failed' ELSE 'was cancelled' END || \
             COALESCE(': ' || job.error, '') \
          FROM pipeline_member AS member JOIN job ON job.id = member.job \
          WHERE member.pipeline = pipeline.id AND job.state IN ('failed', 'cancelled') \
          ORDER BY job.state = 'failed' DESC, member.ordinal LIMIT 1) AS error \
         FROM job AS pipeline JOIN pipeline_member AS member ON member.pipeline = pipeline.id \
         JOIN job ON job.id = member.job WHERE pipeline.id = ? GROUP BY pipeline.id",
    )
    .bind(pipeline)
    .fetch_one(&mut *conn)
    .await?;
    if standing.state.0.is_final() {
        return Ok(());
    }
    let (state, error) = if standing.open > 0 {
        if standing.started == 0 || standing.state.0 == JobState::Running {
            return Ok(());
        }
        (JobState::Running, None)
    } else if standing.unsuccessful == 0 {
        (JobState::Succeeded, None)
    } else if standing.cancel_requested {
        (JobState::Cancelled, None)
    } else if standing.failed > 0 {
        (JobState::Failed, standing.error)
    } else {
        (JobState::Cancelled, standing.error)
    };
    sqlx::query(concat!(
        "UPDATE job SET state = ?1, error = ?2, started_at = COALESCE(started_at, ",
        now!(),
        "), finished_at = CASE WHEN ?1 = 'running' THEN NULL ELSE ",
        now!(),
        " END WHERE id = ?3"
    ))
    .bind(state.as_str())
    .bind(error)
    .bind(pipeline)
    .execute(conn)
    .await?;
    Ok(())
}

impl FromRow<'_, SqliteRow> for Member {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            name: row.try_get("name")?,
            job: row.try_get("job")?,
            kind: row.try_get("kind")?,
            state: row.try_get::<Text<_>, _>("state")?.0,
            error: row.try_get("error")?,
            reused: row.try_get("reused")?,
        })
    }
}
