//! Parts of the page for single kinds of jobs. Other kinds show their tasks, the result of the last
//! task, and their files.

use std::collections::BTreeMap;

use serde::Deserialize;
use spec::{JobKind, ValidationMetric};
use wire::{ControlReport, IdentificationReport, Job, JobState, findings_of};

use crate::app::App;
use crate::error::ApiError;
use crate::page::parts::Link;
use crate::page::text;
use crate::page::verification::outcome;

/// The page with the results of a job with a run, if it is not the job's own page.
pub fn own_page(kind: JobKind, job: i64, run: i64) -> Option<Link> {
    match kind {
        JobKind::Train => Some(Link::new(format!("/runs/{run}"), "loss curve")),
        JobKind::Evaluate => Some(Link::new(format!("/evaluations/{job}"), "figure and table")),
        _ => None,
    }
}

/// The source of the numbers that show how a job went.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Source {
    Dataset(i64),
    Agreement,
    /// A metric of this run.
    Metric(i64),
    /// The headline of the evaluation with this run.
    Evaluation(i64),
    /// The report of a control job, which is the result of its last task.
    ClosedLoop,
    /// The report of an identification, which is the result of its task.
    Identification,
    Result,
}

impl Source {
    fn of(job: &Job) -> Option<Self> {
        let has_succeeded = job.state == JobState::Succeeded;
        match (job.kind, job.dataset) {
            (_, Some(dataset)) if has_succeeded => Some(Self::Dataset(dataset)),
            (JobKind::Verify, _) if has_succeeded => Some(Self::Agreement),
            (JobKind::Train, _) => job.run.map(Self::Metric),
            (JobKind::Evaluate, _) => job.run.map(Self::Evaluation),
            (JobKind::Control, _) => Some(Self::ClosedLoop),
            (JobKind::Identify, _) => Some(Self::Identification),
            _ if has_succeeded && job.members.is_empty() => Some(Self::Result),
            _ => None,
        }
    }
}

/// The main results of jobs, by job. The number of statements does not depend on the number of jobs.
pub async fn headlines(app: &App, jobs: &[&Job]) -> Result<BTreeMap<i64, String>, ApiError> {
    let sources: Vec<(&Job, Source)> =
        jobs.iter().filter_map(|job| Some((*job, Source::of(job)?))).collect();
    if sources.is_empty() {
        return Ok(BTreeMap::new());
    }
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
    let evaluations: Vec<(i64, i64)> = sources
        .iter()
        .filter_map(|(job, source)| match source {
            Source::Evaluation(run) => Some((job.id, *run)),
            _ => None,
        })
        .collect();
    let verifications = of(|job, source| (source == Source::Agreement).then_some(job.id));
    let others = of(|job, source| {
        let has_result =
            matches!(source, Source::ClosedLoop | Source::Identification | Source::Result);
        has_result.then_some(job.id)
    });

    let datasets = match datasets.as_slice() {
        [] => Default::default(),
        ids => app.datasets_by_id(ids).await?,
    };
    let recorded = match recorded.as_slice() {
        [] => Default::default(),
        runs => app.latest_values(runs, ValidationMetric::RmseDeg.key()).await?,
    };
    let evaluations = match evaluations.as_slice() {
        [] => Default::default(),
        ids => app.evaluation_headlines(ids).await?,
    };
    let agreements = match verifications.as_slice() {
        [] => Default::default(),
        jobs => app.agreements(jobs).await?,
    };
    let results = match others.as_slice() {
        [] => Default::default(),
        jobs => app.sole_results(jobs).await?,
    };
    let mut headlines = BTreeMap::new();
    for (job, source) in sources {
        let headline = match source {
            Source::Dataset(id) => datasets.get(&id).map(|dataset| {
                let trajectories = text::counted(dataset.trajectories, "trajectory");
                format!("{trajectories}, {}", text::size(dataset.bytes))
            }),
            Source::Metric(run) => recorded.get(&run).map(|latest| {
                let rmse_deg = latest.value.unwrap_or(f64::NAN);
                format!("last validation RMSE {}°", text::degrees(rmse_deg))
            }),
            Source::Evaluation(_) => evaluations.get(&job.id).map(reports::headline),
            Source::ClosedLoop => results.get(&job.id).and_then(|result| {
                ControlReport::deserialize(result).ok().as_ref().map(reports::closed_loop::headline)
            }),
            Source::Identification => results.get(&job.id).and_then(|result| {
                let report = IdentificationReport::deserialize(result).ok();
                report.as_ref().map(reports::identification::headline)
            }),
            Source::Agreement => agreements.get(&job.id).copied().map(outcome),
            Source::Result => results.get(&job.id).and_then(findings_of),
        };
        headlines.extend(headline.map(|headline| (job.id, headline)));
    }
    Ok(headlines)
}
