//! Submissions: jobs with their tasks, and perhaps the pipeline that they form, in one transaction.

use serde_json::{Value, json};
use spec::{Digest, Execution};
use wire::JobState;

use crate::boxed;
use crate::database::{Scope, Transaction};
use crate::events::tell;
use crate::lists::labels::label_submitted;
use crate::queue::idempotency;
use crate::queue::pipelines;
use crate::queue::propagation::{advance, state_of};
use crate::queue::rules::job::{before_start, is_unsuccessful};
use crate::queue::rules::reuse::{stand_in, takes_over};
use crate::queue::rules::turn::turn;
use crate::queue::statements::submission::{CompletedTask, JobRow};
use crate::{CheckpointId, EventKind, Idempotency, JobId, Labels, Store, StoreError};

/// Jobs that are submitted together.
#[derive(Clone, Debug)]
pub struct Submission {
    /// The jobs. Each comes after the jobs it needs. Without a pipeline there is exactly one.
    pub jobs: Vec<NewJob>,
    /// The pipeline that the jobs form, if they form one.
    pub pipeline: Option<NewPipeline>,
    /// Whether earlier work may be used.
    pub reuse: Reuse,
    /// Makes a repeated request return the outcome of the first one.
    pub idempotency: Option<Idempotency>,
    /// The labels of the pipeline or of the one job. They are not part of a spec and do not change
    /// its digest.
    pub labels: Labels,
}

impl Submission {
    /// Submits one job, or finds the earlier one that stands in for it.
    pub fn of(job: NewJob) -> Self {
        Self {
            jobs: vec![job],
            pipeline: None,
            reuse: Reuse::SameDigest,
            idempotency: None,
            labels: Labels::default(),
        }
    }
}

/// A job to submit. [`NewJob::new`] has a value for each field.
#[derive(Clone, Debug)]
pub struct NewJob {
    /// The name that lists show, until users give it another one.
    pub name: String,
    /// The kind of its spec. The store does not interpret it.
    pub kind: String,
    /// The spec, with every reference resolved to a digest.
    pub spec: Value,
    /// The digest of what the job computes. Jobs with the same digest have the same results.
    pub digest: Digest,
    /// The unit of progress, e.g. `trajectories`.
    pub unit: String,
    /// The place in line, the attempts and the needed resources of its tasks.
    pub execution: Execution,
    /// The result that it leaves.
    pub output: Output,
    /// How far it can use earlier work.
    pub reuse: JobReuse,
    /// Its tasks: at least one, but none for the job of a pipeline.
    pub tasks: Vec<NewTask>,
    /// The jobs that must succeed first.
    pub needs: Vec<Need>,
    /// The digests of the jobs whose data and checkpoints it reads.
    pub reads: Vec<Digest>,
    /// Inputs that are existing checkpoints, so no job is needed for them.
    pub checkpoints: Vec<CheckpointId>,
    /// The sent files that it reads.
    pub files: Vec<Digest>,
}

impl NewJob {
    /// A job named after its kind, without tasks, inputs and results, that an earlier job with the
    /// same spec stands in for.
    pub fn new(kind: &str, spec: Value) -> Self {
        Self {
            name: kind.to_owned(),
            kind: kind.to_owned(),
            digest: Digest::of_json(&spec),
            spec,
            unit: "tasks".to_owned(),
            execution: Execution::default(),
            output: Output::Nothing,
            reuse: JobReuse { whole: true, parts: PartReuse::Nothing },
            tasks: Vec::new(),
            needs: Vec::new(),
            reads: Vec::new(),
            checkpoints: Vec::new(),
            files: Vec::new(),
        }
    }
}

/// The result of a job, besides the results of its tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// A dataset that the job's tasks fill with shards.
    Dataset {
        /// Number of trajectories; 0 if only the task that fills the dataset learns it.
        trajectories: u64,
        /// Number of samples of each trajectory.
        samples: u32,
    },
    /// A run: a record of parameters, metrics, artifacts and checkpoints.
    Run,
    /// It leaves no more than the results of its tasks.
    Nothing,
}

/// How far a new job can use the work of earlier jobs with the same digest, under
/// [`Reuse::SameDigest`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobReuse {
    /// Whether an earlier job that succeeded, or still may, stands in for the new job.
    pub whole: bool,
    /// The parts that the new job takes over from a job that failed or was cancelled.
    pub parts: PartReuse,
}

/// The parts of a job that another job with the same digest can use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartReuse {
    /// Nothing is taken over.
    Nothing,
    /// Results of completed tasks. They are copied when the new job is submitted.
    Tasks,
    /// Shards and checkpoints. Workers of the new job copy them instead of making them again; see
    /// [`Store::earlier_shard`] and [`Store::earlier_checkpoints`].
    Objects,
}

/// A job that must succeed first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// A job of the same submission, by index.
    New(usize),
    /// A job that was submitted before.
    Existing(JobId),
}

/// A task of a job to submit.
#[derive(Clone, Debug)]
pub struct NewTask {
    /// Tasks of a stage wait for all tasks of earlier stages.
    pub stage: u32,
    /// Unique in its stage.
    pub ordinal: u32,
    /// A name for people, such as `shard 3`.
    pub label: String,
    /// The part of the job that it is. The store does not interpret it.
    pub payload: Value,
    /// Amount of work of this task, in the job's unit.
    pub total: u64,
}

/// The pipeline that the jobs of a submission form.
#[derive(Clone, Debug)]
pub struct NewPipeline {
    /// The pipeline itself, which is a job without tasks.
    pub job: NewJob,
    /// Its members, in the order in which they are shown.
    pub members: Vec<NewMember>,
}

/// A member of a pipeline to submit.
#[derive(Clone, Debug)]
pub struct NewMember {
    /// Its name in the pipeline.
    pub name: String,
    /// The index of the job in the submission.
    pub job: usize,
}

/// Whether an existing job may stand in for a new one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reuse {
    /// Yes, as far as the [`JobReuse`] of each job allows. A pipeline is reused as a whole.
    SameDigest,
    /// No: everything is done again.
    Never,
}

/// The outcome of a submission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Submitted {
    /// The pipeline, or the one job.
    pub job: JobId,
    /// Whether the job existed before.
    pub reused: bool,
}

impl Store {
    /// # Errors
    /// When a needed job has failed or was deleted, when an idempotency key was used with another
    /// request, or when the submission contradicts itself. Nothing is submitted then.
    #[boxed]
    pub async fn submit(&self, submission: Submission) -> Result<Submitted, StoreError> {
        check(&submission)?;
        let mut tx = self.begin(Scope::Queue, "submitting a job").await?;
        let submitted = submit(&mut tx, &submission).await?;
        tx.commit().await?;
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

async fn submit(tx: &mut Transaction, submission: &Submission) -> Result<Submitted, StoreError> {
    if let Some(asked) = &submission.idempotency
        && let Some(submitted) = idempotency::repeated(tx, asked).await?
    {
        return Ok(submitted);
    }
    let submitted = match &submission.pipeline {
        Some(pipeline) => submit_pipeline(tx, submission, pipeline).await?,
        None => {
            let new = &submission.jobs[0];
            let submitted = submit_job(tx, new, submission.reuse, &[], false).await?;
            tx.mark_asked_alone(submitted.job).await?;
            submitted
        }
    };
    label_submitted(tx, submitted.job, &submission.labels).await?;
    if let Some(Idempotency { key, request }) = &submission.idempotency {
        tx.remember_request(key, *request, &submitted).await?;
    }
    Ok(submitted)
}

async fn submit_pipeline(
    tx: &mut Transaction,
    submission: &Submission,
    new: &NewPipeline,
) -> Result<Submitted, StoreError> {
    if submission.reuse == Reuse::SameDigest
        && let Some(job) = stand_in(&tx.earlier_jobs(new.job.digest).await?)
    {
        return Ok(Submitted { job, reused: true });
    }
    let mut jobs: Vec<Submitted> = Vec::with_capacity(submission.jobs.len());
    for job in &submission.jobs {
        let submitted = submit_job(tx, job, submission.reuse, &jobs, true).await?;
        jobs.push(submitted);
    }
    let row = JobRow {
        new: &new.job,
        state: JobState::Queued,
        waits_since: tx.waits_since().await?,
        is_part: false,
        takes_over: false,
    };
    let pipeline = insert_job(tx, &row).await?;
    for (ordinal, member) in (0u32..).zip(&new.members) {
        let Submitted { job, reused } = jobs[member.job];
        tx.insert_member(pipeline, ordinal, &member.name, job, reused).await?;
    }
    // All members may have succeeded long ago.
    pipelines::settle(tx, pipeline).await?;
    Ok(Submitted { job: pipeline, reused: false })
}

/// Inserts a job, and writes its event.
async fn insert_job(tx: &mut Transaction, row: &JobRow<'_>) -> Result<JobId, StoreError> {
    let job = tx.insert_job(row).await?;
    let data = json!({
        "kind": row.new.kind, "name": row.new.name, "state": row.state, "error": null,
        "cancel_requested": false,
    });
    tell(tx, EventKind::Job, job, &data).await?;
    Ok(job)
}

/// Inserts `new` or finds the job that stands in for it.
async fn submit_job(
    tx: &mut Transaction,
    new: &NewJob,
    reuse: Reuse,
    submitted: &[Submitted],
    is_part: bool,
) -> Result<Submitted, StoreError> {
    let may_reuse = reuse == Reuse::SameDigest;
    if may_reuse
        && new.reuse.whole
        && let Some(job) = stand_in(&tx.earlier_jobs(new.digest).await?)
    {
        return Ok(Submitted { job, reused: true });
    }
    let needs = needs(new, submitted);
    let mut states = Vec::with_capacity(needs.len());
    for need in &needs {
        let state = state_of(tx, *need).await?;
        if is_unsuccessful(state) {
            return Err(StoreError::NeedNotMet { job: *need, state });
        }
        if tx.job_is_gone(*need).await? {
            return Err(StoreError::InputDeleted { item: (*need).into() });
        }
        states.push(state);
    }
    for checkpoint in &new.checkpoints {
        let item = (*checkpoint).into();
        if tx.item(item).await?.is_none_or(|row| row.deletion.is_some()) {
            return Err(StoreError::InputDeleted { item });
        }
    }
    for file in &new.files {
        if tx.known_upload(*file).await?.is_none() {
            return Err(StoreError::FileDeleted { digest: *file });
        }
    }
    let state = before_start(states);
    let waits_since = tx.waits_since().await?;
    let takes_over = may_reuse && new.reuse.parts == PartReuse::Objects;
    let job = insert_job(tx, &JobRow { new, state, waits_since, is_part, takes_over }).await?;
    for need in needs {
        tx.insert_need(job, need).await?;
    }
    tx.insert_inputs(job, &[&new.reads[..], &new.files].concat()).await?;
    let turn = turn(waits_since, new.execution.not_before, new.execution.priority);
    tx.insert_tasks(job, turn, &new.tasks).await?;
    match new.output {
        Output::Dataset { trajectories, samples } => {
            tx.insert_dataset(job, new.digest, trajectories, samples).await?;
        }
        Output::Run => tx.insert_run(job).await?,
        Output::Nothing => {}
    }
    if may_reuse && new.reuse.parts == PartReuse::Tasks {
        take_over_tasks(tx, job, new).await?;
    }
    if state == JobState::Queued {
        advance(tx, job).await?;
    }
    Ok(Submitted { job, reused: false })
}

/// The ids of the jobs that a new job needs, in order and each once.
fn needs(new: &NewJob, submitted: &[Submitted]) -> Vec<JobId> {
    let job = |need: &Need| match need {
        Need::New(index) => submitted[*index].job,
        Need::Existing(job) => *job,
    };
    let mut needs: Vec<JobId> = new.needs.iter().map(job).collect();
    needs.sort_unstable();
    needs.dedup();
    needs
}

/// Completes tasks of a new job that an earlier job with the same digest completed before it failed
/// or was cancelled. The same digest means the same result. Files that the tasks left stay in the
/// earlier job's run.
async fn take_over_tasks(tx: &mut Transaction, job: JobId, new: &NewJob) -> Result<(), StoreError> {
    let last_stage = new.tasks.iter().map(|task| task.stage).max().unwrap_or(0);
    for CompletedTask { task, place, payload } in tx.completed_tasks(new.digest).await? {
        let same_place =
            |task: &&NewTask| (task.stage, task.ordinal) == (place.stage, place.ordinal);
        let Some(at_place) = new.tasks.iter().find(same_place) else { continue };
        let asked = at_place.payload.to_string();
        if takes_over(place, last_stage, asked == payload) {
            tx.take_over(job, place, task).await?;
        }
    }
    Ok(())
}
