//! Jobs in a row: how far each is, what it found, and where to look.

use spec::JobKind;
use wire::{Job, JobState, Member};

use crate::app::App;
use crate::error::ApiError;
use crate::page::kinds::{headline, own_page};
use crate::page::parts::{Bar, Link};
use crate::page::text;

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
            metric: headline(app, job).await?,
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
    let own = job.run.filter(|_| has_begun).and_then(|run| own_page(job.kind, job.id, run));
    let last = job.checkpoints.last();
    let checkpoint = last.map(|id| Link::new(format!("/checkpoints/{id}"), "checkpoint"));
    dataset.into_iter().chain(verified).chain(own).chain(checkpoint).collect()
}
