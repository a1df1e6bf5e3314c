//! Parts of the page that belong to single kinds of jobs. Any other kind is shown by its tasks, what the last of
//! them reports, and the files that it left.

use spec::JobKind;
use wire::{Job, JobState, Tasks};

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

/// The numbers that say how a job went.
pub async fn headline(app: &App, job: &Job) -> Result<String, ApiError> {
    match (job.kind, job.dataset) {
        (_, Some(dataset)) if job.state == JobState::Succeeded => {
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
            Ok(report.as_ref().map_or(String::new(), report::headline))
        }
        (JobKind::Control, _) => {
            let report = app.report(job.id).await?;
            Ok(report.as_ref().map_or(String::new(), control::headline))
        }
        _ if job.state == JobState::Succeeded && job.members.is_empty() => {
            let tasks = Tasks { tasks: app.tasks(job.id).await? };
            Ok(tasks.findings().unwrap_or_default())
        }
        _ => Ok(String::new()),
    }
}
