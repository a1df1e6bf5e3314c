//! Rows for jobs: their progress, their main result, and links.

use std::collections::BTreeSet;
use std::iter;

use reports::comparison::swept;
use serde_json::Value;
use spec::JobKind;
use wire::{Job, JobState, Member};

use crate::app::App;
use crate::error::ApiError;
use crate::limits::COMPARED_RUNS;
use crate::page::kinds::{headlines, own_page};
use crate::page::parts::{Bar, Link};
use crate::page::text;

/// One job among others.
pub struct Row {
    pub href: String,
    pub name: String,
    pub kind: JobKind,
    /// Its values of the fields that a sweep varies. Empty outside a sweep.
    pub swept: String,
    pub run: Option<i64>,
    pub state: JobState,
    pub progress: Option<Bar>,
    /// A text in place of the progress.
    pub remark: String,
    /// The main result.
    pub metric: String,
    pub links: Vec<Link>,
}

impl Row {
    fn new(job: &Job, headline: Option<&String>) -> Self {
        let took = job.duration_seconds.map(|seconds| format!("took {}", text::duration(seconds)));
        Self {
            href: format!("/jobs/{}", job.id),
            name: job.name.clone(),
            kind: job.kind,
            swept: String::new(),
            run: job.run,
            state: job.state,
            progress: Bar::of(job.state, &job.progress),
            remark: took.or_else(|| job.waits_for.clone()).unwrap_or_default(),
            metric: headline.cloned().unwrap_or_default(),
            links: results(job),
        }
    }

    fn of_member(member: &Member, row: Self) -> Self {
        let remark = match &member.error {
            Some(error) => error.clone(),
            None if member.reused && member.state == JobState::Succeeded => "reused".to_owned(),
            None => row.remark,
        };
        Self { name: member.name.clone(), remark, ..row }
    }

    /// The rows of each of `jobs`, in order. A pipeline has the rows of its members, and any other
    /// job its own row. The number of statements does not depend on the number of jobs.
    pub async fn of_each(app: &App, jobs: &[Job]) -> Result<Vec<Vec<Self>>, ApiError> {
        let members: BTreeSet<i64> =
            jobs.iter().flat_map(|job| &job.members).map(|member| member.job).collect();
        let members = app.jobs_by_id(&members.into_iter().collect::<Vec<_>>()).await?;
        let single = jobs.iter().filter(|job| job.kind != JobKind::Pipeline);
        let shown: Vec<&Job> = members.values().chain(single).collect();
        let headlines = headlines(app, &shown).await?;
        let row = |job: &Job| Self::new(job, headlines.get(&job.id));
        let of_members = |job: &Job| -> Vec<Self> {
            let known = job.members.iter();
            let known = known.filter_map(|member| Some((member, members.get(&member.job)?)));
            let known: Vec<(&Member, &Job)> = known.collect();
            let specs: Vec<&Value> = known.iter().map(|(_, job)| &job.spec).collect();
            let values = swept(&specs).into_iter().chain(iter::repeat(String::new()));
            let rows = known.into_iter().zip(values);
            rows.map(|((member, job), swept)| Self { swept, ..Self::of_member(member, row(job)) })
                .collect()
        };
        let rows = |job: &Job| match job.kind {
            JobKind::Pipeline => of_members(job),
            _ => vec![row(job)],
        };
        Ok(jobs.iter().map(rows).collect())
    }
}

/// The page that compares the runs of a sweep; `None` for other jobs, and with too few or too many
/// runs.
pub fn comparison(rows: &[Row]) -> Option<String> {
    let swept = rows.iter().filter(|row| !row.swept.is_empty());
    let runs: BTreeSet<i64> = swept.filter_map(|row| row.run).collect();
    let runs: Vec<String> = runs.iter().map(i64::to_string).collect();
    (2..=COMPARED_RUNS).contains(&runs.len()).then(|| format!("/compare?run={}", runs.join(",")))
}

/// Links to the results of a job so far.
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
