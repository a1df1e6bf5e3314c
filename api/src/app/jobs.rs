//! Jobs and the members of pipelines.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use serde_json::Value;
use spec::{Execution, JobKind, JobSpec, Product};
use store::{JobId, Listed, Listing, Store, StoreError, Timestamp};
use wire::{Job, JobProgress, JobState, Member, Membership, Progress};

use crate::app::App;
use crate::app::resources::Resource;
use crate::app::room;
use crate::app::waits::sentence;
use crate::error::ApiError;

impl Resource for Job {
    type Row = store::Job;

    async fn rows(store: &Store, listing: &Listing) -> Result<Listed<Self::Row>, StoreError> {
        store.list_jobs(listing).await
    }

    fn spec(row: &Self::Row) -> Option<&Value> {
        Some(&row.spec)
    }

    async fn complete(app: &App, rows: Vec<Self::Row>) -> Result<Vec<Self>, ApiError> {
        app.complete(rows).await
    }

    async fn find(app: &App, id: i64) -> Result<Self, ApiError> {
        app.job(id).await
    }
}

impl App {
    pub(crate) async fn job(&self, id: i64) -> Result<Job, ApiError> {
        let row = self.store.job(JobId(id)).await?;
        self.complete(vec![row]).await?.pop().ok_or(ApiError::Internal)
    }

    /// Those of the jobs with these ids that exist, by id.
    pub(crate) async fn jobs_by_id(&self, ids: &[i64]) -> Result<BTreeMap<i64, Job>, ApiError> {
        let ids: Vec<JobId> = ids.iter().copied().map(JobId).collect();
        let jobs = self.complete(self.store.jobs_by_id(&ids).await?).await?;
        Ok(jobs.into_iter().map(|job| (job.id, job)).collect())
    }

    /// Cancels a job. A job that was cancelled before stays cancelled.
    pub(crate) async fn cancel(&self, id: i64) -> Result<Job, ApiError> {
        let before = self.store.job(JobId(id)).await?;
        if matches!(before.state, JobState::Succeeded | JobState::Failed) {
            return Err(ApiError::AlreadyFinal { id, state: before.state });
        }
        self.store.cancel(JobId(id)).await?;
        self.job(id).await
    }

    /// Adds data from other tables to jobs. The number of statements does not depend on the number
    /// of jobs.
    pub(super) async fn complete(&self, rows: Vec<store::Job>) -> Result<Vec<Job>, ApiError> {
        let mut known = self.known_of(&rows).await?;
        let specs: Vec<&Value> = rows.iter().map(|row| &row.spec).collect();
        let warnings = jobs::warnings(&self.store, &specs, self.memory_doubts.as_deref()).await?;
        let jobs = rows.into_iter().zip(warnings);
        let complete = |(row, mut warnings): (store::Job, Vec<String>)| {
            warnings.extend(self.room_doubt(&row)?);
            known.complete(row, warnings)
        };
        jobs.map(complete).collect()
    }

    /// A warning about a job that the disk has no room for.
    fn room_doubt(&self, row: &store::Job) -> Result<Option<String>, ApiError> {
        let writes = [JobKind::Simulate, JobKind::Pipeline].map(JobKind::as_str);
        if row.state.is_final() || !writes.contains(&row.kind.as_str()) {
            return Ok(None);
        }
        // Another version may have stored the spec.
        let Ok(spec) = serde_json::from_value::<JobSpec>(row.spec.clone()) else { return Ok(None) };
        let space = self.store.disk_space_of_results()?;
        Ok(space.and_then(|space| room::doubt(&spec, &row.progress, space)))
    }

    /// The progress of jobs. The number of statements does not depend on the number of jobs.
    pub(super) async fn progress_of(
        &self,
        rows: Vec<store::Job>,
    ) -> Result<Vec<JobProgress>, ApiError> {
        let mut known = self.known_of(&rows).await?;
        let progress = |row: store::Job| JobProgress {
            job: row.id.0,
            state: row.state,
            error: row.error,
            cancel_requested: row.cancel_requested,
            progress: progress(row.progress),
            waits_for: known.waits.get(&row.id).cloned(),
            members: known.members.remove(&row.id).unwrap_or_default(),
        };
        Ok(rows.into_iter().map(progress).collect())
    }

    /// For the queued jobs among these, a sentence about why they wait.
    async fn waits(&self, jobs: &[JobId]) -> Result<HashMap<JobId, String>, ApiError> {
        let waits = self.store.waits(jobs).await?;
        if waits.is_empty() {
            return Ok(HashMap::new());
        }
        let engine = self.store.engine().await?.map(|engine| engine.name);
        let told = |(job, wait)| (job, sentence(&wait, engine.as_deref()));
        Ok(waits.into_iter().map(told).collect())
    }

    async fn known_of(&self, rows: &[store::Job]) -> Result<Known, ApiError> {
        let mut known = Known::default();
        let jobs: Vec<JobId> = rows.iter().map(|row| row.id).collect();
        for (job, need) in self.store.needs(&jobs).await? {
            known.needs.entry(job).or_default().push(need.0);
        }
        let of_kind = |fits: fn(JobKind) -> bool| -> Vec<JobId> {
            let fits = |row: &&store::Job| row.kind.parse::<JobKind>().is_ok_and(fits);
            rows.iter().filter(fits).map(|row| row.id).collect()
        };
        for row in self.store.memberships(&jobs).await? {
            let store::Membership { job, pipeline, pipeline_name: name, name: member } = row;
            let membership = Membership { id: pipeline.0, name, member };
            known.pipelines.entry(job).or_default().push(membership);
        }
        let pipelines = of_kind(|kind| kind == JobKind::Pipeline);
        let mut members = Vec::new();
        if !pipelines.is_empty() {
            members = self.store.members(&pipelines).await?;
        }
        let open = rows.iter().filter(|row| !row.state.is_final()).map(|row| row.id);
        let open_members = members.iter().filter(|row| !row.state.is_final()).map(|row| row.job);
        let open: BTreeSet<JobId> = open.chain(open_members).collect();
        if !open.is_empty() {
            known.waits = self.waits(&open.into_iter().collect::<Vec<_>>()).await?;
        }
        for member in members {
            let (pipeline, waits_for) = (member.pipeline, known.waits.get(&member.job).cloned());
            let member = seen_by_pipeline(member, waits_for)?;
            known.members.entry(pipeline).or_default().push(member);
        }
        let trainings = of_kind(|kind| kind.makes() == Some(Product::Checkpoints));
        if !trainings.is_empty() {
            for (job, checkpoint) in self.store.checkpoint_ids(&trainings).await? {
                known.checkpoints.entry(job).or_default().push(checkpoint.0);
            }
        }
        let verifications = of_kind(|kind| kind == JobKind::Verify);
        let needs = verifications.iter().filter_map(|job| known.needs.get(job)?.first());
        let needs: Vec<JobId> = needs.copied().map(JobId).collect();
        if !needs.is_empty() {
            let datasets = self.store.datasets_of_jobs(&needs).await?;
            known.datasets = datasets.into_iter().map(|(job, id)| (job.0, id.0)).collect();
        }
        Ok(known)
    }
}

/// Data about jobs from other tables, by job.
#[derive(Default)]
struct Known {
    needs: HashMap<JobId, Vec<i64>>,
    members: HashMap<JobId, Vec<Member>>,
    /// The pipelines of each job.
    pipelines: HashMap<JobId, Vec<Membership>>,
    /// For queued jobs, a sentence about why they wait.
    waits: HashMap<JobId, String>,
    checkpoints: HashMap<JobId, Vec<i64>>,
    /// The datasets that verifications check, by the job that made each dataset.
    datasets: HashMap<i64, i64>,
}

impl Known {
    fn complete(&mut self, row: store::Job, warnings: Vec<String>) -> Result<Job, ApiError> {
        let kind: JobKind = row.kind.parse()?;
        let needs = self.needs.remove(&row.id).unwrap_or_default();
        let verifies = match (kind, needs.first()) {
            (JobKind::Verify, Some(need)) => self.datasets.get(need).copied(),
            _ => None,
        };
        let duration_seconds = duration_seconds(&row);
        let Execution { priority, max_attempts, time_limit_s, resources, not_before } =
            row.execution;
        Ok(Job {
            duration_seconds,
            id: row.id.0,
            kind,
            name: row.name,
            note: row.note,
            tags: row.tags,
            state: row.state,
            error: row.error,
            digest: row.digest,
            warnings,
            spec: row.spec,
            progress: progress(row.progress),
            needs,
            members: self.members.remove(&row.id).unwrap_or_default(),
            pipelines: self.pipelines.remove(&row.id).unwrap_or_default(),
            dataset: row.dataset.map(|id| id.0),
            verifies,
            run: row.run.map(|id| id.0),
            checkpoints: self.checkpoints.remove(&row.id).unwrap_or_default(),
            priority,
            max_attempts,
            time_limit_s,
            resources,
            not_before: not_before.map(|moment| moment.to_string()),
            waits_for: self.waits.get(&row.id).cloned(),
            cancel_requested: row.cancel_requested,
            created_at: row.created_at.to_string(),
            started_at: text(row.started_at),
            finished_at: text(row.finished_at),
        })
    }
}

fn seen_by_pipeline(row: store::Member, waits_for: Option<String>) -> Result<Member, ApiError> {
    Ok(Member {
        name: row.name,
        job: row.job.0,
        kind: row.kind.parse()?,
        state: row.state,
        error: row.error,
        progress: progress(row.progress),
        waits_for,
        reused: row.reused,
    })
}

/// Seconds from start to end, if both are known.
#[expect(clippy::cast_precision_loss, reason = "milliseconds of a job are exact in f64")]
fn duration_seconds(row: &store::Job) -> Option<f64> {
    let (started, finished) = (row.started_at?, row.finished_at?);
    Some((finished.milliseconds() - started.milliseconds()) as f64 / 1000.0)
}

pub(super) fn text(time: Option<Timestamp>) -> Option<String> {
    time.map(|time| time.to_string())
}

fn progress(row: store::JobProgress) -> Progress {
    let store::JobProgress { done, total, unit, rate_per_second, message } = row;
    Progress { done, total, unit, rate_per_second, message }
}
