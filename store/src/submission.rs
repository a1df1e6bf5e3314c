//! A submission: jobs with their tasks, and perhaps the pipeline they form, in one transaction.

use serde_json::Value;
use spec::{DataSpec, Digest, JobKind, JobSpec, PipelineSpec};
use sqlx::SqliteConnection;

use crate::clock::now;
use crate::database::integer;
use crate::propagation::queue_first_stage;
use crate::{JobId, JobState, Store, StoreError, pipelines};

/// What is asked for at once.
#[derive(Clone, Debug)]
pub struct Submission {
    /// Each after the jobs it needs. Without a pipeline, exactly one.
    pub jobs: Vec<NewJob>,
    pub pipeline: Option<NewPipeline>,
    pub reuse: Reuse,
    pub idempotency: Option<Idempotency>,
}

#[derive(Clone, Debug)]
pub struct NewJob {
    pub name: String,
    /// With every reference resolved to a digest; anything but a pipeline.
    pub spec: JobSpec,
    /// What progress counts, e.g. `trajectories`.
    pub unit: String,
    pub tasks: Vec<NewTask>,
    pub needs: Vec<Need>,
}

/// A job that must succeed first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// Index into the jobs of the same submission.
    New(usize),
    Existing(JobId),
}

#[derive(Clone, Debug)]
pub struct NewTask {
    /// Tasks of a stage wait for all tasks of the stages before.
    pub stage: u32,
    /// Unique in its stage.
    pub ordinal: u32,
    pub label: String,
    pub payload: Value,
    /// How much of the job's unit this task does.
    pub total: u64,
}

#[derive(Clone, Debug)]
pub struct NewPipeline {
    pub spec: PipelineSpec,
    pub members: Vec<NewMember>,
}

#[derive(Clone, Debug)]
pub struct NewMember {
    pub name: String,
    /// Index into the jobs of the submission.
    pub job: usize,
}

/// Whether a job that was already asked for stands in for a new one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reuse {
    /// One of the same digest that succeeded or still may. An evaluation takes over the cells of one
    /// that failed.
    SameDigest,
    Never,
}

/// Makes a repeated request return what the first one did.
#[derive(Clone, Debug)]
pub struct Idempotency {
    pub key: String,
    /// Digest of the request, to refuse the same key with another request.
    pub request: Digest,
}

/// What became of a submission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Submitted {
    /// The pipeline, or the one job.
    pub job: JobId,
    /// Whether it was there before.
    pub reused: bool,
}

/// Idempotency keys are kept for a day.
const KEEP_KEYS_MILLISECONDS: i64 = 24 * 60 * 60 * 1000;

impl Store {
    /// # Errors
    /// When a need has failed, an idempotency key comes with another request, or the submission
    /// contradicts itself; nothing is submitted then.
    pub async fn submit(&self, submission: Submission) -> Result<Submitted, StoreError> {
        check(&submission)?;
        const OPERATION: &str = "submitting a job";
        let mut tx = self.database().write(OPERATION).await?;
        let submitted = submit(&mut tx, &submission).await?;
        tx.commit().await.map_err(StoreError::database(OPERATION))?;
        Ok(submitted)
    }
}

fn check(submission: &Submission) -> Result<(), StoreError> {
    let inconsistent = |reason: String| Err(StoreError::InvalidSubmission { reason });
    if submission.pipeline.is_none() && submission.jobs.len() != 1 {
        return inconsistent(format!("{} jobs without a pipeline", submission.jobs.len()));
    }
    for (i, job) in submission.jobs.iter().enumerate() {
        if job.spec.kind() == JobKind::Pipeline || job.tasks.is_empty() {
            return inconsistent(format!("job {:?} has no tasks", job.name));
        }
        if job.needs.iter().any(|need| matches!(need, Need::New(needed) if *needed >= i)) {
            return inconsistent(format!("job {:?} comes before one it needs", job.name));
        }
    }
    if let Some(pipeline) = &submission.pipeline {
        let known = |member: &NewMember| member.job < submission.jobs.len();
        if pipeline.members.is_empty() || !pipeline.members.iter().all(known) {
            return inconsistent("a pipeline has no members or unknown ones".to_owned());
        }
    }
    Ok(())
}

async fn submit(
    conn: &mut SqliteConnection,
    submission: &Submission,
) -> Result<Submitted, StoreError> {
    let failed = StoreError::database("submitting a job");
    if let Some(idempotency) = &submission.idempotency
        && let Some(submitted) = replay(conn, idempotency).await?
    {
        return Ok(submitted);
    }
    let submitted = match &submission.pipeline {
        Some(pipeline) => submit_pipeline(conn, submission, pipeline).await?,
        None => {
            let (job, reused) =
                submit_job(conn, &submission.jobs[0], submission.reuse, &[]).await?;
            sqlx::query("UPDATE job SET asked_alone = 1 WHERE id = ? AND asked_alone = 0")
                .bind(job)
                .execute(&mut *conn)
                .await
                .map_err(&failed)?;
            Submitted { job, reused }
        }
    };
    if let Some(idempotency) = &submission.idempotency {
        sqlx::query(concat!(
            "INSERT INTO idempotency_key (key, request, job, reused, created_at) ",
            "VALUES (?, ?, ?, ?, ",
            now!(),
            ")"
        ))
        .bind(&idempotency.key)
        .bind(idempotency.request.to_string())
        .bind(submitted.job)
        .bind(submitted.reused)
        .execute(&mut *conn)
        .await
        .map_err(&failed)?;
    }
    Ok(submitted)
}

/// What the first request with this key did.
async fn replay(
    conn: &mut SqliteConnection,
    idempotency: &Idempotency,
) -> Result<Option<Submitted>, StoreError> {
    let failed = StoreError::database("looking up an idempotency key");
    sqlx::query(concat!("DELETE FROM idempotency_key WHERE created_at < ", now!(), " - ?"))
        .bind(KEEP_KEYS_MILLISECONDS)
        .execute(&mut *conn)
        .await
        .map_err(&failed)?;
    let known: Option<(String, JobId, bool)> =
        sqlx::query_as("SELECT request, job, reused FROM idempotency_key WHERE key = ?")
            .bind(&idempotency.key)
            .fetch_optional(&mut *conn)
            .await
            .map_err(&failed)?;
    match known {
        Some((request, job, reused)) if request == idempotency.request.to_string() => {
            Ok(Some(Submitted { job, reused }))
        }
        Some(_) => Err(StoreError::IdempotencyConflict { key: idempotency.key.clone() }),
        None => Ok(None),
    }
}

async fn submit_pipeline(
    conn: &mut SqliteConnection,
    submission: &Submission,
    new: &NewPipeline,
) -> Result<Submitted, StoreError> {
    let spec = JobSpec::Pipeline(new.spec.clone());
    if submission.reuse == Reuse::SameDigest
        && let Some(job) = reusable(conn, spec.digest()).await?
    {
        return Ok(Submitted { job, reused: true });
    }
    let mut jobs: Vec<(JobId, bool)> = Vec::with_capacity(submission.jobs.len());
    for job in &submission.jobs {
        let submitted = submit_job(conn, job, submission.reuse, &jobs).await?;
        jobs.push(submitted);
    }
    let pipeline =
        insert_job(conn, &new.spec.name, &spec, "jobs", JobState::Queued, AskedFor::Alone).await?;
    for (ordinal, member) in (0i64..).zip(&new.members) {
        let (job, reused) = jobs[member.job];
        sqlx::query(
            "INSERT INTO pipeline_member (pipeline, name, ordinal, job, reused) \
             VALUES (?, ?, ?, ?, ?)",
        )
        .bind(pipeline)
        .bind(&member.name)
        .bind(ordinal)
        .bind(job)
        .bind(reused)
        .execute(&mut *conn)
        .await
        .map_err(StoreError::database("submitting a pipeline"))?;
    }
    // Its members may all have succeeded long ago.
    pipelines::settle(conn, pipeline)
        .await
        .map_err(StoreError::database("submitting a pipeline"))?;
    Ok(Submitted { job: pipeline, reused: false })
}

/// Inserts `new` or finds the job that stands in for it; true when found. None stands in for a
/// verification, which says what was the case when it ran.
async fn submit_job(
    conn: &mut SqliteConnection,
    new: &NewJob,
    reuse: Reuse,
    submitted: &[(JobId, bool)],
) -> Result<(JobId, bool), StoreError> {
    if reuse == Reuse::SameDigest
        && new.spec.kind() != JobKind::Verify
        && let Some(job) = reusable(conn, new.spec.digest()).await?
    {
        return Ok((job, true));
    }
    let mut needs: Vec<JobId> = new
        .needs
        .iter()
        .map(|need| match need {
            Need::New(index) => submitted[*index].0,
            Need::Existing(job) => *job,
        })
        .collect();
    needs.sort_unstable();
    needs.dedup();
    let mut unmet = false;
    for need in &needs {
        match state_of(conn, *need).await? {
            JobState::Succeeded => {}
            state @ (JobState::Failed | JobState::Cancelled) => {
                return Err(StoreError::NeedNotMet { job: *need, state });
            }
            JobState::Waiting | JobState::Queued | JobState::Running => unmet = true,
        }
    }
    let state = if unmet { JobState::Waiting } else { JobState::Queued };
    let job =
        insert_job(conn, &new.name, &new.spec, &new.unit, state, AskedFor::ByPipeline).await?;
    let failed = StoreError::database("submitting a job");
    for need in needs {
        sqlx::query("INSERT INTO job_need (job, needs) VALUES (?, ?)")
            .bind(job)
            .bind(need)
            .execute(&mut *conn)
            .await
            .map_err(&failed)?;
    }
    insert_tasks(conn, job, new).await.map_err(&failed)?;
    insert_results(conn, job, &new.spec).await.map_err(&failed)?;
    if reuse == Reuse::SameDigest && new.spec.kind() == JobKind::Evaluate {
        take_over_tasks(conn, job, new.spec.digest()).await.map_err(&failed)?;
    }
    if !unmet {
        queue_first_stage(conn, job).await.map_err(&failed)?;
    }
    Ok((job, false))
}

/// The job that stands in for a new one of the same digest: one that succeeded, or else the
/// newest that still may, which a pipeline with a failed member may not.
async fn reusable(
    conn: &mut SqliteConnection,
    digest: Digest,
) -> Result<Option<JobId>, StoreError> {
    sqlx::query_scalar(
        "SELECT id FROM job WHERE digest = ? AND (state = 'succeeded' \
         OR state IN ('waiting', 'queued', 'running') AND cancel_requested = 0 AND NOT EXISTS \
            (SELECT 1 FROM pipeline_member JOIN job AS member ON member.id = pipeline_member.job \
             WHERE pipeline_member.pipeline = job.id AND member.state IN ('failed', 'cancelled'))) \
         ORDER BY state = 'succeeded' DESC, id DESC LIMIT 1",
    )
    .bind(digest.to_string())
    .fetch_optional(conn)
    .await
    .map_err(StoreError::database("looking up a job by digest"))
}

async fn state_of(conn: &mut SqliteConnection, job: JobId) -> Result<JobState, StoreError> {
    sqlx::query_scalar("SELECT state FROM job WHERE id = ?")
        .bind(job)
        .fetch_optional(conn)
        .await
        .map_err(StoreError::database("looking up a job"))?
        .ok_or_else(|| StoreError::not_found("job", job.to_string()))
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum AskedFor {
    Alone,
    ByPipeline,
}

async fn insert_job(
    conn: &mut SqliteConnection,
    name: &str,
    spec: &JobSpec,
    unit: &str,
    state: JobState,
    asked_for: AskedFor,
) -> Result<JobId, StoreError> {
    let execution = spec.execution();
    sqlx::query_scalar(concat!(
        "INSERT INTO job (kind, name, spec, digest, state, unit, priority, max_attempts, ",
        "asked_alone, created_at) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ",
        now!(),
        ") RETURNING id"
    ))
    .bind(spec.kind().as_str())
    .bind(name)
    .bind(spec.to_json().to_string())
    .bind(spec.digest().to_string())
    .bind(state)
    .bind(unit)
    .bind(execution.priority)
    .bind(execution.max_attempts)
    .bind(asked_for == AskedFor::Alone)
    .fetch_one(conn)
    .await
    .map_err(StoreError::database("submitting a job"))
}

async fn insert_tasks(
    conn: &mut SqliteConnection,
    job: JobId,
    new: &NewJob,
) -> Result<(), sqlx::Error> {
    let execution = new.spec.execution();
    for task in &new.tasks {
        sqlx::query(
            "INSERT INTO task (job, stage, ordinal, label, payload, state, priority, run_at, \
             max_attempts, total) VALUES (?, ?, ?, ?, ?, 'waiting', ?, 0, ?, ?)",
        )
        .bind(job)
        .bind(task.stage)
        .bind(task.ordinal)
        .bind(&task.label)
        .bind(task.payload.to_string())
        .bind(execution.priority)
        .bind(execution.max_attempts)
        .bind(integer(task.total))
        .execute(&mut *conn)
        .await?;
    }
    Ok(())
}

/// Completes the tasks of a new job that an earlier one of the same digest completed, though it failed
/// or was cancelled later: the same digest is the same result. What they left lies in its run. The
/// last stage is always done again, for what it leaves belongs to the new job's run.
async fn take_over_tasks(
    conn: &mut SqliteConnection,
    job: JobId,
    digest: Digest,
) -> Result<(), sqlx::Error> {
    sqlx::query(
        "UPDATE task SET state = 'succeeded', done = task.total, result = made.result, \
         worker = made.worker, started_at = made.started_at, finished_at = made.finished_at \
         FROM (SELECT task.*, MAX(task.id) FROM task JOIN job ON job.id = task.job \
               WHERE job.digest = ?2 AND job.id <> ?1 AND task.state = 'succeeded' \
               AND task.result IS NOT NULL GROUP BY task.stage, task.ordinal) AS made \
         WHERE task.job = ?1 AND task.stage = made.stage AND task.ordinal = made.ordinal \
         AND task.payload = made.payload \
         AND task.stage < (SELECT MAX(stage) FROM task WHERE job = ?1)",
    )
    .bind(job)
    .bind(digest.to_string())
    .execute(conn)
    .await?;
    Ok(())
}

/// Every simulation and import fills a dataset; every training, evaluation and control job is recorded
/// in a run.
async fn insert_results(
    conn: &mut SqliteConnection,
    job: JobId,
    spec: &JobSpec,
) -> Result<(), sqlx::Error> {
    let dataset = DataSpec::of(spec);
    match (spec, dataset) {
        (_, Some(data)) => {
            sqlx::query(concat!(
                "INSERT INTO dataset (job, digest, state, trajectories, samples, created_at) ",
                "VALUES (?, ?, 'building', ?, ?, ",
                now!(),
                ")"
            ))
            .bind(job)
            .bind(spec.digest().to_string())
            // An import learns how many there are when it ends.
            .bind(integer(data.trajectories().unwrap_or(0)))
            .bind(data.samples())
            .execute(conn)
            .await?;
        }
        (JobSpec::Train(_) | JobSpec::Evaluate(_) | JobSpec::Control(_), None) => {
            sqlx::query(concat!("INSERT INTO run (job, created_at) VALUES (?, ", now!(), ")"))
                .bind(job)
                .execute(conn)
                .await?;
        }
        (_, None) => {}
    }
    Ok(())
}
