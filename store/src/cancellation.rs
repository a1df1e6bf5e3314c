//! Cancellation, as users ask for it.

use std::collections::BTreeSet;

use sqlx::SqliteConnection;
use sqlx::types::Text;

use crate::propagation::stop;
use crate::{JobId, JobState, Store, StoreError, pipelines};

impl Store {
    /// Cancels a job: tasks that nobody has end now, running ones when their worker notices.
    /// Of a pipeline, cancels the members that nothing else alive needs. A job that has ended
    /// stays as it is.
    ///
    /// # Errors
    /// When there is no such job.
    pub async fn cancel(&self, job: JobId) -> Result<(), StoreError> {
        const OPERATION: &str = "cancelling a job";
        let failed = StoreError::database(OPERATION);
        let mut tx = self.database().write(OPERATION).await?;
        let found: Option<(Text<JobState>, bool)> = sqlx::query_as(
            "SELECT state, EXISTS (SELECT 1 FROM pipeline_member WHERE pipeline = job.id) \
             FROM job WHERE id = ?",
        )
        .bind(job)
        .fetch_optional(&mut *tx)
        .await
        .map_err(&failed)?;
        let (Text(state), has_members) =
            found.ok_or_else(|| StoreError::not_found("job", job.to_string()))?;
        if state.is_final() {
            return Ok(());
        }
        if has_members {
            cancel_pipeline(&mut tx, job).await.map_err(&failed)?;
        } else {
            request(&mut tx, job).await.map_err(&failed)?;
            stop(&mut tx, job).await.map_err(&failed)?;
        }
        tx.commit().await.map_err(&failed)
    }
}

async fn cancel_pipeline(conn: &mut SqliteConnection, pipeline: JobId) -> Result<(), sqlx::Error> {
    request(conn, pipeline).await?;
    let members = members_to_cancel(conn, pipeline).await?;
    // All are marked before the first ends, since a pipeline settles when none that is marked is
    // left.
    for member in &members {
        request(conn, *member).await?;
    }
    for member in members {
        stop(conn, member).await?;
    }
    pipelines::settle(conn, pipeline).await
}

async fn request(conn: &mut SqliteConnection, job: JobId) -> Result<(), sqlx::Error> {
    sqlx::query("UPDATE job SET cancel_requested = 1 WHERE id = ?").bind(job).execute(conn).await?;
    Ok(())
}

/// Members that have not ended, were not asked for alone, are in no other live pipeline, and are
/// needed by no live job outside of these.
async fn members_to_cancel(
    conn: &mut SqliteConnection,
    pipeline: JobId,
) -> Result<BTreeSet<JobId>, sqlx::Error> {
    let mut members: BTreeSet<JobId> = sqlx::query_scalar(
        "SELECT job.id FROM pipeline_member AS member JOIN job ON job.id = member.job \
         WHERE member.pipeline = ? AND job.asked_alone = 0 \
         AND job.state IN ('waiting', 'queued', 'running') \
         AND NOT EXISTS (SELECT 1 FROM pipeline_member AS other \
             JOIN job AS pipeline ON pipeline.id = other.pipeline \
             WHERE other.job = job.id AND pipeline.cancel_requested = 0 \
             AND pipeline.state IN ('waiting', 'queued', 'running'))",
    )
    .bind(pipeline)
    .fetch_all(&mut *conn)
    .await?
    .into_iter()
    .collect();
    loop {
        let mut kept = Vec::new();
        for member in &members {
            let needed_by: Vec<JobId> = sqlx::query_scalar(
                "SELECT job.id FROM job_need JOIN job ON job.id = job_need.job \
                 WHERE job_need.needs = ? AND job.state = 'waiting'",
            )
            .bind(*member)
            .fetch_all(&mut *conn)
            .await?;
            if needed_by.iter().any(|job| !members.contains(job)) {
                kept.push(*member);
            }
        }
        if kept.is_empty() {
            return Ok(members);
        }
        for job in kept {
            members.remove(&job);
        }
    }
}
