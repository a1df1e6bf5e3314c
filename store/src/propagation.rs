//! What follows when a task ends: its job moves on, jobs that need it are queued or cancelled,
//! pipelines settle. Always inside the transaction that ended the task.

use sqlx::SqliteConnection;
use sqlx::types::Text;

use crate::clock::now;
use crate::{JobId, JobState, datasets, pipelines};

/// Moves a job on after one of its tasks ended.
pub(crate) async fn after_task(conn: &mut SqliteConnection, job: JobId) -> Result<(), sqlx::Error> {
    let Text(state): Text<JobState> = sqlx::query_scalar("SELECT state FROM job WHERE id = ?")
        .bind(job)
        .fetch_one(&mut *conn)
        .await?;
    if state.is_final() {
        // It failed while this task was still running.
        return Ok(());
    }
    let failure: Option<String> = sqlx::query_scalar(
        "SELECT label || ': ' || COALESCE(error, 'failed') FROM task \
         WHERE job = ? AND state = 'failed' ORDER BY id LIMIT 1",
    )
    .bind(job)
    .fetch_optional(&mut *conn)
    .await?;
    if failure.is_some() {
        stop_tasks(conn, job).await?;
        return finish(conn, job, JobState::Failed, failure).await;
    }
    let open_stage: Option<i64> = sqlx::query_scalar(
        "SELECT MIN(stage) FROM task WHERE job = ? AND state IN ('waiting', 'queued', 'running')",
    )
    .bind(job)
    .fetch_one(&mut *conn)
    .await?;
    if let Some(stage) = open_stage {
        return queue_stage(conn, job, stage).await;
    }
    let cancelled: bool = sqlx::query_scalar(
        "SELECT EXISTS (SELECT 1 FROM task WHERE job = ? AND state = 'cancelled')",
    )
    .bind(job)
    .fetch_one(&mut *conn)
    .await?;
    let state = if cancelled { JobState::Cancelled } else { JobState::Succeeded };
    finish(conn, job, state, None).await
}

/// Makes the first tasks of a queued job claimable; some may be done, taken over from another job.
pub(crate) async fn queue_first_stage(
    conn: &mut SqliteConnection,
    job: JobId,
) -> Result<(), sqlx::Error> {
    let stage: i64 = sqlx::query_scalar(
        "SELECT COALESCE(MIN(stage), 0) FROM task WHERE job = ? AND state = 'waiting'",
    )
    .bind(job)
    .fetch_one(&mut *conn)
    .await?;
    queue_stage(conn, job, stage).await
}

/// Changes nothing when the stage's tasks were queued before: they all are at once.
async fn queue_stage(
    conn: &mut SqliteConnection,
    job: JobId,
    stage: i64,
) -> Result<(), sqlx::Error> {
    sqlx::query(concat!(
        "UPDATE task SET state = 'queued', run_at = ",
        now!(),
        " WHERE job = ? AND stage = ? AND state = 'waiting'"
    ))
    .bind(job)
    .bind(stage)
    .execute(conn)
    .await?;
    Ok(())
}

/// Cancels tasks that nobody has and asks for the end of those that somebody has.
pub(crate) async fn stop_tasks(conn: &mut SqliteConnection, job: JobId) -> Result<(), sqlx::Error> {
    sqlx::query(concat!(
        "UPDATE task SET state = 'cancelled', finished_at = ",
        now!(),
        " WHERE job = ? AND state IN ('waiting', 'queued')"
    ))
    .bind(job)
    .execute(&mut *conn)
    .await?;
    sqlx::query("UPDATE task SET cancel_requested = 1 WHERE job = ? AND state = 'running'")
        .bind(job)
        .execute(conn)
        .await?;
    Ok(())
}

/// Gives a job its final state, and tells all that depends on it.
async fn finish(
    conn: &mut SqliteConnection,
    job: JobId,
    state: JobState,
    error: Option<String>,
) -> Result<(), sqlx::Error> {
    let mut finishing = vec![(job, state, error)];
    while let Some((job, state, error)) = finishing.pop() {
        let finished = sqlx::query(concat!(
            "UPDATE job SET state = ?, error = ?, finished_at = ",
            now!(),
            " WHERE id = ? AND state IN ('waiting', 'queued', 'running')"
        ))
        .bind(state.as_str())
        .bind(error)
        .bind(job)
        .execute(&mut *conn)
        .await?;
        if finished.rows_affected() == 0 {
            continue;
        }
        if state == JobState::Succeeded {
            datasets::complete(conn, job).await?;
            queue_dependents(conn, job).await?;
        } else {
            let reason = format!("needs job {job}, which {}", past_tense(state));
            for dependent in dependents(conn, job).await? {
                stop_tasks(conn, dependent).await?;
                finishing.push((dependent, JobState::Cancelled, Some(reason.clone())));
            }
        }
        pipelines::settle_those_of(conn, job).await?;
    }
    Ok(())
}

const fn past_tense(state: JobState) -> &'static str {
    match state {
        JobState::Failed => "failed",
        _ => "was cancelled",
    }
}

async fn dependents(conn: &mut SqliteConnection, job: JobId) -> Result<Vec<JobId>, sqlx::Error> {
    sqlx::query_scalar(
        "SELECT job.id FROM job_need JOIN job ON job.id = job_need.job \
         WHERE job_need.needs = ? AND job.state = 'waiting' ORDER BY job.id",
    )
    .bind(job)
    .fetch_all(conn)
    .await
}

/// Queues the jobs for which `job` was the last they waited for.
async fn queue_dependents(conn: &mut SqliteConnection, job: JobId) -> Result<(), sqlx::Error> {
    let ready: Vec<JobId> = sqlx::query_scalar(
        "UPDATE job SET state = 'queued' WHERE state = 'waiting' \
         AND id IN (SELECT job FROM job_need WHERE needs = ?) \
         AND NOT EXISTS (SELECT 1 FROM job_need JOIN job AS needed ON needed.id = job_need.needs \
                         WHERE job_need.job = job.id AND needed.state <> 'succeeded') \
         RETURNING id",
    )
    .bind(job)
    .fetch_all(&mut *conn)
    .await?;
    for job in ready {
        queue_first_stage(conn, job).await?;
    }
    Ok(())
}

/// Ends a job whose cancellation was requested, unless a worker still has some of its tasks.
pub(crate) async fn stop(conn: &mut SqliteConnection, job: JobId) -> Result<(), sqlx::Error> {
    stop_tasks(conn, job).await?;
    after_task(conn, job).await
}
