//! A submission: jobs with their tasks, and perhaps the pipeline they form, in one transaction.

use serde_json::Value;
use spec::Digest;
use sqlx::SqliteConnection;
use sqlx::types::Text;

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
    /// Opaque to the store.
    pub kind: String,
    /// With every reference resolved to a digest.
    pub spec: Value,
    pub digest: Digest,
    /// What progress counts, e.g. `trajectories`.
    pub unit: String,
    /// Higher goes first.
    pub priority: i32,
    /// Times a task may be claimed before it fails.
    pub max_attempts: u32,
    pub output: Output,
    pub reuse: JobReuse,
    pub tasks: Vec<NewTask>,
    pub needs: Vec<Need>,
}

/// What a job leaves beside the results of its tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// One that its tasks fill with shards.
    Dataset {
        /// 0 when only the task that fills it learns how many there are.
        trajectories: u64,
        /// Of each trajectory.
        samples: u32,
    },
    /// A record of parameters, metrics, artifacts and checkpoints.
    Run,
    Nothing,
}

/// How far the work of earlier jobs of the same digest does for a new one, under
/// [`Reuse::SameDigest`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobReuse {
    /// One that succeeded, or still may, stands in for the new job.
    pub whole: bool,
    /// The new job takes over the tasks that one completed before it failed or was cancelled.
    pub tasks: bool,
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
    pub name: String,
    /// Opaque to the store, which knows a pipeline by its members.
    pub kind: String,
    pub spec: Value,
    pub digest: Digest,
    pub priority: i32,
    pub max_attempts: u32,
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
    /// As far as the [`JobReuse`] of each job allows; a pipeline as a whole.
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
        if job.tasks.is_empty() {
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
    if submission.reuse == Reuse::SameDigest
        && let Some(job) = reusable(conn, new.digest).await?
    {
        return Ok(Submitted { job, reused: true });
    }
    let mut jobs: Vec<(JobId, bool)> = Vec::with_capacity(submission.jobs.len());
    for job in &submission.jobs {
        let submitted = submit_job(conn, job, submission.reuse, &jobs).await?;
        jobs.push(submitted);
    }
    let row = JobRow {
        kind: &new.kind,
        name: &new.name,
        spec: &new.spec,
        digest: new.digest,
        unit: "jobs",
        priority: new.priority,
        max_attempts: new.max_attempts,
        asked_alone: true,
    };
    let pipeline = insert_job(conn, &row, JobState::Queued).await?;
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

/// Inserts `new` or finds the job that stands in for it; true when found.
async fn submit_job(
    conn: &mut SqliteConnection,
    new: &NewJob,
    reuse: Reuse,
    submitted: &[(JobId, bool)],
) -> Result<(JobId, bool), StoreError> {
    if reuse == Reuse::SameDigest
        && new.reuse.whole
        && let Some(job) = reusable(conn, new.digest).await?
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
    let row = JobRow {
        kind: &new.kind,
        name: &new.name,
        spec: &new.spec,
        digest: new.digest,
        unit: &new.unit,
        priority: new.priority,
        max_attempts: new.max_attempts,
        asked_alone: false,
    };
    let job = insert_job(conn, &row, state).await?;
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
    insert_output(conn, job, new).await.map_err(&failed)?;
    if reuse == Reuse::SameDigest && new.reuse.tasks {
        take_over_tasks(conn, job, new.digest).await.map_err(&failed)?;
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
    let state: Option<Text<JobState>> = sqlx::query_scalar("SELECT state FROM job WHERE id = ?")
        .bind(job)
        .fetch_optional(conn)
        .await
        .map_err(StoreError::database("looking up a job"))?;
    let Text(state) = state.ok_or_else(|| StoreError::not_found("job", job.to_string()))?;
    Ok(state)
}

/// What the row of a job is made from.
struct JobRow<'a> {
    kind: &'a str,
    name: &'a str,
    spec: &'a Value,
    digest: Digest,
    unit: &'a str,
    priority: i32,
    max_attempts: u32,
    asked_alone: bool,
}

async fn insert_job(
    conn: &mut SqliteConnection,
    row: &JobRow<'_>,
    state: JobState,
) -> Result<JobId, StoreError> {
    sqlx::query_scalar(concat!(
        "INSERT INTO job (kind, name, spec, digest, state, unit, priority, max_attempts, ",
        "asked_alone, created_at) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ",
        now!(),
        ") RETURNING id"
    ))
    .bind(row.kind)
    .bind(row.name)
    .bind(row.spec.to_string())
    .bind(row.digest.to_string())
    .bind(state.as_str())
    .bind(row.unit)
    .bind(row.priority)
    .bind(row.max_attempts)
    .bind(row.asked_alone)
    .fetch_one(conn)
    .await
    .map_err(StoreError::database("submitting a job"))
}

async fn insert_tasks(
    conn: &mut SqliteConnection,
    job: JobId,
    new: &NewJob,
) -> Result<(), sqlx::Error> {
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
        .bind(new.priority)
        .bind(new.max_attempts)
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

async fn insert_output(
    conn: &mut SqliteConnection,
    job: JobId,
    new: &NewJob,
) -> Result<(), sqlx::Error> {
    match new.output {
        Output::Dataset { trajectories, samples } => {
            sqlx::query(concat!(
                "INSERT INTO dataset (job, digest, state, trajectories, samples, created_at) ",
                "VALUES (?, ?, 'building', ?, ?, ",
                now!(),
                ")"
            ))
            .bind(job)
            .bind(new.digest.to_string())
            .bind(integer(trajectories))
            .bind(samples)
            .execute(conn)
            .await?;
        }
        Output::Run => {
            sqlx::query(concat!("INSERT INTO run (job, created_at) VALUES (?, ", now!(), ")"))
                .bind(job)
                .execute(conn)
                .await?;
        }
        Output::Nothing => {}
    }
    Ok(())
}
