//! Shows a job's progress on stderr until it ends: bars on a terminal, and plain lines otherwise.

mod display;
pub mod measure;
mod own_work;

use std::time::{Duration, Instant};

use reqwest::StatusCode;
use wire::{Event, Job, JobProgress};

use crate::client::{Client, ClientError, Events};
use display::{Display, Rate, Row};
pub use own_work::{OwnWork, Part, ProgressCallback, follow_own, follow_parts};

/// How often this process, or a server without events, is asked.
const POLL_EVERY: Duration = Duration::from_millis(400);

/// How long to wait for a server that does not answer. It may be restarting.
const PATIENCE: Duration = Duration::from_secs(30);

/// Shows a job until it ends, and returns it.
///
/// # Errors
/// When the server refuses, or does not answer for 30 s.
pub async fn follow(client: &Client, id: i64) -> Result<Job, ClientError> {
    let mut display = Display::new();
    let mut rates: Vec<Rate> = Vec::new();
    let show = |job: &Job| {
        let now = Instant::now();
        let mut rows = rows(job);
        rates.resize_with(rows.len(), Rate::default);
        for (row, rate) in rows.iter_mut().zip(&mut rates) {
            let observed = rate.observe(row.progress.done, now);
            row.rate_per_second = row.progress.rate_per_second.or(observed);
        }
        display.show(&rows);
    };
    let job = follow_quietly(client, id, show).await?;
    display.finish();
    Ok(job)
}

/// Passes a job to `seen` whenever it has changed, until it ends, and returns it. The server sends
/// changes. A server that cannot, because it is an earlier version or has too many clients, is
/// polled.
///
/// # Errors
/// When the server refuses, or does not answer for 30 s.
pub async fn follow_quietly(
    client: &Client,
    id: i64,
    mut seen: impl FnMut(&Job),
) -> Result<Job, ClientError> {
    let mut events = Some(client.events(format!("/v1/jobs/{id}/events"), None));
    let mut last_answer = Instant::now();
    loop {
        let mut job = match client.job(id).await {
            Ok(job) => job,
            Err(ClientError::Unreachable { .. }) if last_answer.elapsed() < PATIENCE => {
                tokio::time::sleep(POLL_EVERY).await;
                continue;
            }
            Err(error) => return Err(error),
        };
        last_answer = Instant::now();
        seen(&job);
        if job.state.is_final() {
            return Ok(job);
        }
        let Some(stream) = &mut events else {
            tokio::time::sleep(POLL_EVERY).await;
            continue;
        };
        match progress_until_change(stream, &mut job, &mut seen).await {
            Ok(()) => last_answer = Instant::now(),
            // The next request for the job shows whether the server is gone.
            Err(ClientError::Unreachable { .. }) => {}
            Err(ClientError::Refused { status, .. }) if has_no_events(status) => events = None,
            Err(error) => return Err(error),
        }
    }
}

/// Whether a server that answers with this status has no events for this client.
fn has_no_events(status: StatusCode) -> bool {
    [StatusCode::NOT_FOUND, StatusCode::SERVICE_UNAVAILABLE, StatusCode::TOO_MANY_REQUESTS]
        .contains(&status)
}

/// Updates the progress of `job`, and returns when something else has changed.
async fn progress_until_change(
    events: &mut Events<'_>,
    job: &mut Job,
    seen: &mut impl FnMut(&Job),
) -> Result<(), ClientError> {
    loop {
        match events.next().await? {
            Event::Progress(progress) if progress.state == job.state => {
                update_progress(job, progress);
                seen(job);
            }
            // The progress event that follows includes these changes.
            Event::Task(_) | Event::Metrics(_) => {}
            Event::Job(event) if event.job != job.id => {}
            Event::Progress(_)
            | Event::Job(_)
            | Event::Checkpoint(_)
            | Event::Deletion(_)
            | Event::Gap(_)
            | Event::End(_) => return Ok(()),
        }
    }
}

fn update_progress(job: &mut Job, now: JobProgress) {
    job.error = now.error;
    job.cancel_requested = now.cancel_requested;
    job.progress = now.progress;
    job.waits_for = now.waits_for;
    job.members = now.members;
}

fn rows(job: &Job) -> Vec<Row> {
    if job.members.is_empty() {
        return vec![Row {
            name: job.kind.to_string(),
            state: job.state,
            reused: false,
            error: job.error.clone(),
            waits_for: job.waits_for.clone(),
            progress: job.progress.clone(),
            rate_per_second: None,
        }];
    }
    job.members
        .iter()
        .map(|member| Row {
            name: member.name.clone(),
            state: member.state,
            reused: member.reused,
            error: member.error.clone(),
            waits_for: member.waits_for.clone(),
            progress: member.progress.clone(),
            rate_per_second: None,
        })
        .collect()
}
