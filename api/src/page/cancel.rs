//! The page with the question whether to cancel a job, which says what is lost, and the form that cancels it.

use askama::Template;
use axum::extract::State;
use axum::response::{IntoResponse, Redirect, Response};
use spec::JobKind;
use wire::{ItemKind, Job, JobState, Member, Progress};

use crate::app::App;
use crate::error::ApiError;
use crate::extract::Path;
use crate::page::answer::{InPage, PageError, html};
use crate::page::parts::JobHeader;
use crate::page::text;

#[derive(Template)]
#[template(path = "cancel.html")]
struct CancelPage {
    job: JobHeader,
    /// Sentences about the work that is lost. Empty for a pipeline, whose jobs have their own.
    lost: String,
    /// The jobs of a pipeline that have not ended.
    members: Vec<Open>,
    members_left_out: usize,
    /// The jobs that wait for it.
    waiting: Vec<Open>,
    waiting_left_out: usize,
}

/// A job that is cancelled along with another.
struct Open {
    id: i64,
    name: String,
    state: JobState,
    lost: String,
}

/// Jobs in a list of the page. The others are counted.
const LISTED: usize = 20;

/// Asks whether to cancel the job. One that has ended is shown instead.
pub async fn ask(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
) -> Result<Response, PageError> {
    let job = app.job(id).await?;
    if job.state.is_final() {
        return Ok(Redirect::to(&format!("/jobs/{id}")).into_response());
    }
    let open: Vec<&Member> = job.members.iter().filter(|member| !member.state.is_final()).collect();
    let mut members = Vec::new();
    for member in open.iter().take(LISTED) {
        members.push(Open {
            id: member.job,
            name: member.name.clone(),
            state: member.state,
            lost: lost(&app, member.job, member.kind, &member.progress).await?,
        });
    }
    let mut waiting = waiting(&app, &job).await?;
    let waiting_left_out = waiting.len().saturating_sub(LISTED);
    waiting.truncate(LISTED);
    let page = CancelPage {
        lost: lost(&app, id, job.kind, &job.progress).await?,
        members_left_out: open.len() - members.len(),
        members,
        waiting,
        waiting_left_out,
        job: JobHeader::of(&job),
    };
    Ok(html(&page)?)
}

/// Cancels the job and shows it. A job that has just ended by itself is no error.
pub async fn cancel(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
) -> Result<Response, PageError> {
    match app.cancel(id).await {
        Ok(_) | Err(ApiError::AlreadyFinal { .. }) => {
            Ok(Redirect::to(&format!("/jobs/{id}")).into_response())
        }
        Err(error) => Err(error.into()),
    }
}

/// The jobs outside its pipeline that cannot begin without this job.
async fn waiting(app: &App, job: &Job) -> Result<Vec<Open>, ApiError> {
    let dependents = app.dependents(ItemKind::Job, job.id).await?.jobs;
    let waiting = dependents.iter().filter(|it| it.state == JobState::Waiting);
    let waiting: Vec<i64> = waiting.map(|dependent| dependent.id).collect();
    let made: Vec<i64> = match job.members.as_slice() {
        [] => vec![job.id],
        members => members.iter().map(|member| member.job).collect(),
    };
    let waits = |other: &Job| {
        !made.contains(&other.id) && other.needs.iter().any(|needed| made.contains(needed))
    };
    let found = app.jobs_by_id(&waiting).await?.into_values().filter(waits);
    Ok(found
        .map(|job| Open { id: job.id, name: job.name, state: job.state, lost: String::new() })
        .collect())
}

/// Sentences about the work of a job that is lost if it is cancelled, and that a retry goes on from.
async fn lost(app: &App, job: i64, kind: JobKind, progress: &Progress) -> Result<String, ApiError> {
    if kind == JobKind::Pipeline {
        return Ok(String::new());
    }
    if progress.done == 0 && kind != JobKind::Train {
        return Ok("No part of it is done, so nothing is lost.".to_owned());
    }
    let Progress { done, total, unit, .. } = progress;
    let parts = format!("Done: {} of {} {unit}.", text::count(*done), text::count(*total));
    Ok(match kind {
        JobKind::Train => {
            let last = app.checkpoints_of_job(job).await?.last().map(|checkpoint| checkpoint.step);
            of_training(*done, *total, last)
        }
        JobKind::Simulate => {
            format!("{parts} Complete shards are kept, and a retry goes on with the others.")
        }
        JobKind::Evaluate => {
            format!("{parts} Evaluated cells are kept, and a retry goes on with the others.")
        }
        _ => format!("{parts} This work is lost: a retry begins again."),
    })
}

/// `last` is the step of the last checkpoint.
fn of_training(done: u64, total: u64, last: Option<u64>) -> String {
    if done == 0 {
        return "It has taken no step, so nothing is lost.".to_owned();
    }
    let last = match last {
        Some(step) if step >= done => {
            return format!(
                "It is at step {} of {}. A retry goes on from there.",
                text::count(done),
                text::count(total)
            );
        }
        Some(step) => format!("goes on from step {}, its last checkpoint", text::count(step)),
        None => "begins again".to_owned(),
    };
    format!(
        "It is at step {} of {}, and writes a checkpoint as it ends. A retry goes on from there. \
         If its worker is gone and writes none, a retry {last}.",
        text::count(done),
        text::count(total),
    )
}

#[cfg(test)]
mod tests {
    use super::of_training;

    #[test]
    fn a_training_says_from_which_step_a_retry_goes_on() {
        assert!(of_training(0, 100, None).contains("nothing is lost"));
        let at_a_checkpoint = of_training(50, 100, Some(50));
        assert_eq!(at_a_checkpoint, "It is at step 50 of 100. A retry goes on from there.");
        assert!(
            of_training(60, 100, Some(50)).ends_with("goes on from step 50, its last checkpoint.")
        );
        assert!(of_training(60, 100, None).ends_with("writes none, a retry begins again."));
    }
}
