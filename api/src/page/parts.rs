//! What several pages show in the same way.

use axum::http::HeaderMap;
use axum::http::header::HOST;
use spec::JobKind;

use crate::app::{App, Job, JobState, Member, Progress, Report};
use crate::error::ApiError;
use crate::page::report::headline;
use crate::page::text;

/// A progress bar and the words below it.
#[derive(Debug, PartialEq)]
pub struct Bar {
    pub done: u64,
    pub total: u64,
    pub text: String,
}

impl Bar {
    /// The bar of a job that is running; others have nothing to show.
    pub fn of(state: JobState, progress: &Progress) -> Option<Self> {
        (state == JobState::Running).then(|| Self::new(progress))
    }

    #[expect(clippy::cast_precision_loss, reason = "an estimate of the time left")]
    pub fn new(progress: &Progress) -> Self {
        let Progress { done, total, .. } = *progress;
        if total == 0 {
            let text = progress.message.clone().unwrap_or_else(|| "starting".to_owned());
            return Self { done: 0, total: 1, text };
        }
        let mut parts =
            vec![format!("{} of {} {}", text::count(done), text::count(total), progress.unit)];
        if let Some(rate) = progress.rate_per_second.filter(|rate| *rate > 0.0) {
            parts.push(text::rate(rate));
            if done < total {
                parts.push(format!("{} left", text::duration((total - done) as f64 / rate)));
            }
        }
        parts.extend(progress.message.clone());
        Self { done: done.min(total), total, text: parts.join(" · ") }
    }
}

/// One job in a table of jobs.
pub struct Row {
    pub href: String,
    pub name: String,
    pub kind: String,
    pub state: JobState,
    pub progress: Option<Bar>,
    /// What there is to say instead of progress.
    pub remark: String,
    /// The one number that a reader looks for first.
    pub metric: String,
}

/// A link among a page's results.
pub struct Link {
    pub href: String,
    pub label: String,
}

impl Link {
    pub fn new(href: impl Into<String>, label: impl Into<String>) -> Self {
        Self { href: href.into(), label: label.into() }
    }
}

/// A value with its name and, smaller, what it needs beside it.
pub struct Fact {
    pub name: String,
    pub value: String,
    pub note: String,
}

impl Fact {
    pub fn new(name: impl Into<String>, value: impl Into<String>, note: impl Into<String>) -> Self {
        Self { name: name.into(), value: value.into(), note: note.into() }
    }
}

/// A file in a table of files.
pub struct FileRow {
    pub url: String,
    pub name: String,
    pub contents: String,
    pub size: String,
    pub sha256: String,
}

impl Row {
    pub fn of_member(member: &Member, metric: String) -> Self {
        let remark = match (&member.error, member.reused) {
            (Some(error), _) => error.clone(),
            (None, true) if member.state == JobState::Succeeded => "reused".to_owned(),
            (None, _) => String::new(),
        };
        Self {
            href: format!("/jobs/{}", member.job),
            name: member.name.clone(),
            kind: member.kind.to_string(),
            state: member.state,
            progress: Bar::of(member.state, &member.progress),
            remark,
            metric,
        }
    }

    pub fn of_job(job: &Job, metric: String) -> Self {
        Self {
            href: format!("/jobs/{}", job.id),
            name: job.name.clone(),
            kind: job.kind.to_string(),
            state: job.state,
            progress: Bar::of(job.state, &job.progress),
            remark: String::new(),
            metric,
        }
    }
}

/// A spec as it can be read and submitted again.
pub fn pretty(spec: &serde_json::Value) -> String {
    format!("{spec:#}")
}

/// When a job was submitted and how long it took.
pub fn when(job: &Job) -> String {
    let submitted = job.created_at.split('.').next().unwrap_or("").replace('T', " ");
    match job.duration_seconds {
        Some(seconds) => format!("{submitted} UTC · took {}", text::duration(seconds)),
        None => format!("{submitted} UTC"),
    }
}

/// The address that the reader used, for commands to copy.
pub fn origin(headers: &HeaderMap) -> String {
    let host = headers.get(HOST).and_then(|host| host.to_str().ok()).unwrap_or("127.0.0.1:7070");
    format!("http://{host}")
}

/// The number that says how a job went.
pub async fn key_metric(app: &App, job: i64, kind: JobKind) -> Result<String, ApiError> {
    match kind {
        JobKind::Train => {
            let latest = app.latest_metric_of_job(job, "validation/rmse_deg").await?;
            Ok(latest.map_or(String::new(), |latest| {
                format!("validation RMSE {}°", text::degrees(latest.value))
            }))
        }
        JobKind::Evaluate => {
            let report: Option<Report> =
                app.report(job).await?.and_then(|report| serde_json::from_value(report).ok());
            Ok(report.as_ref().map_or(String::new(), headline))
        }
        JobKind::Simulate | JobKind::Pipeline => Ok(String::new()),
    }
}
