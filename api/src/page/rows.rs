//! Jobs in a row: how far each is, what it found, and where to look.

use spec::JobKind;
use wire::{Job, JobState, Member};

use crate::app::App;
use crate::error::ApiError;
use crate::page::control;
use crate::page::parts::{Bar, Link};
use crate::page::report::headline;
use crate::page::text;
use crate::page::verification::outcome;

/// One job among others.
pub struct Row {
    pub href: String,
    pub name: String,
    pub kind: JobKind,
    pub state: JobState,
    pub progress: Option<Bar>,
    /// What there is to say instead of progress.
    pub remark: String,
    /// What a reader looks for first.
    pub metric: String,
    pub links: Vec<Link>,
}

impl Row {
    pub async fn of_job(app: &App, job: &Job) -> Result<Self, ApiError> {
        let took = job.duration_seconds.map(|it| format!("took {}", text::duration(it)));
        Ok(Self {
            href: format!("/jobs/{}", job.id),
            name: job.name.clone(),
            kind: job.kind,
            state: job.state,
            progress: Bar::of(job.state, &job.progress),
            remark: took.unwrap_or_default(),
            metric: key_metric(app, job).await?,
            links: results(job),
        })
    }

    async fn of_member(app: &App, member: &Member, job: &Job) -> Result<Self, ApiError> {
        let row = Self::of_job(app, job).await?;
        let remark = match &member.error {
            Some(error) => error.clone(),
            None if member.reused && member.state == JobState::Succeeded => "reused".to_owned(),
            None => row.remark,
        };
        Ok(Self { name: member.name.clone(), remark, ..row })
    }

    /// A row for every job of a pipeline.
    pub async fn of_members(app: &App, pipeline: &Job) -> Result<Vec<Self>, ApiError> {
        let mut rows = Vec::with_capacity(pipeline.members.len());
        let jobs = app.jobs_of_pipeline(pipeline.id).await?;
        for (member, job) in pipeline.members.iter().zip(&jobs) {
            rows.push(Self::of_member(app, member, job).await?);
        }
        Ok(rows)
    }
}

/// Where to see what a job has made so far.
pub fn results(job: &Job) -> Vec<Link> {
    let has_begun = job.started_at.is_some();
    let dataset = job.dataset.filter(|_| has_begun);
    let dataset = dataset.map(|id| Link::new(format!("/datasets/{id}"), "dataset"));
    let verified = job
        .verifies
        .map(|id| Link::new(format!("/datasets/{id}#verification"), format!("dataset {id}")));
    let figure = match (job.kind, job.run.filter(|_| has_begun)) {
        (JobKind::Train, Some(run)) => Some(Link::new(format!("/runs/{run}"), "loss curve")),
        (JobKind::Evaluate, Some(_)) => {
            Some(Link::new(format!("/evaluations/{}", job.id), "figure and table"))
        }
        _ => None,
    };
    let last = job.checkpoints.last();
    let checkpoint = last.map(|id| Link::new(format!("/checkpoints/{id}"), "checkpoint"));
    dataset.into_iter().chain(verified).chain(figure).chain(checkpoint).collect()
}

/// The numbers that say how a job went.
async fn key_metric(app: &App, job: &Job) -> Result<String, ApiError> {
    match (job.kind, job.dataset) {
        (JobKind::Simulate | JobKind::Import, Some(dataset))
            if job.state == JobState::Succeeded =>
        {
            let dataset = app.dataset_without_files(dataset).await?;
            let trajectories = text::count(dataset.trajectories);
            Ok(format!("{trajectories} trajectories, {}", text::size(dataset.bytes)))
        }
        (JobKind::Verify, _) if job.state == JobState::Succeeded => {
            Ok(outcome(&app.verification_by(job.id).await?))
        }
        (JobKind::Train, _) => {
            let latest = app.latest_metric_of_job(job.id, "validation/rmse_deg").await?;
            Ok(latest.map_or(String::new(), |latest| {
                let rmse_deg = latest.value.unwrap_or(f64::NAN);
                format!("validation RMSE {}°", text::degrees(rmse_deg))
            }))
        }
        (JobKind::Evaluate, _) => {
            let report = app.report(job.id).await?;
            Ok(report.as_ref().map_or(String::new(), headline))
        }
        (JobKind::Control, _) => {
            let report = app.report(job.id).await?;
            Ok(report.as_ref().map_or(String::new(), control::headline))
        }
        _ => Ok(String::new()),
    }
}
