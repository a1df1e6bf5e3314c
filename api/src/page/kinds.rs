//! Parts of the page that belong to single kinds of jobs. Any other kind is shown by its tasks, what the last of
//! them reports, and the files that it left.

use std::collections::BTreeMap;

use spec::{JobKind, ValidationMetric};
use store::Artifact;
use wire::{Job, JobState, findings_of};

use crate::app::App;
use crate::error::ApiError;
use crate::page::control::ClosedLoop;
use crate::page::parts::Link;
use crate::page::verification::outcome;
use crate::page::{control, report, text};

/// The page that shows what a job with a run found, where that is not the job's.
pub fn own_page(kind: JobKind, job: i64, run: i64) -> Option<Link> {
    match kind {
        JobKind::Train => Some(Link::new(format!("/runs/{run}"), "loss curve")),
        JobKind::Evaluate => Some(Link::new(format!("/evaluations/{job}"), "figure and table")),
        _ => None,
    }
}

/// The findings that the page of a job shows, besides files.
pub async fn closed_loop(app: &App, job: &Job) -> Result<Option<ClosedLoop>, ApiError> {
    match job.kind {
        JobKind::Control => ClosedLoop::of(app, job).await,
        _ => Ok(None),
    }
}

/// Where the numbers are that say how a job went.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Source {
    Dataset(i64),
    Agreement,
    /// In the metrics of this run.
    Metric(i64),
    /// In the report of this run.
    Report(i64),
    Result,
}

impl Source {
    fn of(job: &Job) -> Option<Self> {
        let has_succeeded = job.state == JobState::Succeeded;
        match (job.kind, job.dataset) {
            (_, Some(dataset)) if has_succeeded => Some(Self::Dataset(dataset)),
            (JobKind::Verify, _) if has_succeeded => Some(Self::Agreement),
            (JobKind::Train, _) => job.run.map(Self::Metric),
            (JobKind::Evaluate | JobKind::Control, _) => job.run.map(Self::Report),
            _ if has_succeeded && job.members.is_empty() => Some(Self::Result),
            _ => None,
        }
    }
}

/// The numbers that say how jobs went, by job. The database is asked as often for one job as for many.
pub async fn headlines(app: &App, jobs: &[&Job]) -> Result<BTreeMap<i64, String>, ApiError> {
    let sources: Vec<(&Job, Source)> =
        jobs.iter().filter_map(|job| Some((*job, Source::of(job)?))).collect();
    let of = |id: fn(&Job, Source) -> Option<i64>| -> Vec<i64> {
        sources.iter().filter_map(|(job, source)| id(job, *source)).collect()
    };
    let datasets = of(|_, source| match source {
        Source::Dataset(dataset) => Some(dataset),
        _ => None,
    });
    let recorded = of(|_, source| match source {
        Source::Metric(run) => Some(run),
        _ => None,
    });
    let reported = of(|_, source| match source {
        Source::Report(run) => Some(run),
        _ => None,
    });
    let verifications = of(|job, source| (source == Source::Agreement).then_some(job.id));
    let others = of(|job, source| (source == Source::Result).then_some(job.id));

    let datasets = app.datasets_by_id(&datasets).await?;
    let recorded = app.latest_values(&recorded, ValidationMetric::RmseDeg.key()).await?;
    let reported = app.report_files(&reported).await?;
    let agreements = app.agreements(&verifications).await?;
    let results = app.sole_results(&others).await?;
    let mut headlines = BTreeMap::new();
    for (job, source) in sources {
        let headline = match source {
            Source::Dataset(id) => datasets.get(&id).map(|dataset| {
                let trajectories = text::count(dataset.trajectories);
                format!("{trajectories} trajectories, {}", text::size(dataset.bytes))
            }),
            Source::Metric(run) => recorded.get(&run).map(|latest| {
                let rmse_deg = latest.value.unwrap_or(f64::NAN);
                format!("validation RMSE {}°", text::degrees(rmse_deg))
            }),
            Source::Report(run) => match reported.get(&run) {
                Some(file) => of_report(app, job.kind, file).await?,
                None => None,
            },
            Source::Agreement => agreements.get(&job.id).copied().map(outcome),
            Source::Result => results.get(&job.id).and_then(findings_of),
        };
        headlines.extend(headline.map(|headline| (job.id, headline)));
    }
    Ok(headlines)
}

/// The mean errors of the evaluations with these runs, in a line each, by run.
pub async fn evaluation_headlines(
    app: &App,
    runs: &[i64],
) -> Result<BTreeMap<i64, String>, ApiError> {
    let mut headlines = BTreeMap::new();
    for (run, file) in app.report_files(runs).await? {
        let headline = of_report(app, JobKind::Evaluate, &file).await?;
        headlines.extend(headline.map(|headline| (run, headline)));
    }
    Ok(headlines)
}

/// A damaged report is the trouble of its own page, not of every list that has its job.
async fn of_report(app: &App, kind: JobKind, file: &Artifact) -> Result<Option<String>, ApiError> {
    let headline = match kind {
        JobKind::Control => {
            app.read_report(file).await.map(|it| it.as_ref().map(control::headline))
        }
        _ => app.read_report(file).await.map(|it| it.as_ref().map(report::headline)),
    };
    match headline {
        Err(error @ ApiError::Damaged { .. }) => {
            error.log();
            Ok(None)
        }
        headline => headline,
    }
}
