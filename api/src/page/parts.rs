//! Parts that several pages share.

use axum::http::HeaderMap;
use axum::http::header::HOST;
use spec::JobKind;
use wire::{Artifact, Job, JobState, Membership, Progress};

use crate::access;
use crate::page::instant::Instant;
use crate::page::text;

/// Warnings that stand open below each other. Further ones are folded.
pub const WARNINGS: usize = 3;

/// A progress bar with a text below it.
#[derive(Debug, PartialEq)]
pub struct Bar {
    pub done: u64,
    pub total: u64,
    pub text: String,
}

impl Bar {
    /// The bar of a running job. Other jobs have none.
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

/// A named value, with a smaller text beside it.
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

/// A file that a job left.
pub struct FileLink {
    pub url: String,
    pub name: String,
    pub size: String,
}

impl From<Artifact> for FileLink {
    fn from(artifact: Artifact) -> Self {
        Self { url: artifact.url, name: artifact.name, size: text::size(artifact.size) }
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

/// The job of a page and its progress.
pub struct JobHeader {
    pub id: i64,
    pub name: String,
    pub kind: JobKind,
    pub state: JobState,
    pub submitted: Instant,
    /// How long it took; empty before it ended.
    pub took: String,
    /// Why its queued tasks wait, besides waiting for their turn.
    pub waits_for: String,
    /// Whether it has ended.
    pub settled: bool,
    /// It failed or was cancelled.
    pub can_retry: bool,
    pub error: String,
    pub progress: Option<Bar>,
    pub pipelines: Vec<Link>,
}

impl JobHeader {
    pub fn of(job: &Job) -> Self {
        Self {
            id: job.id,
            name: job.name.clone(),
            kind: job.kind,
            state: job.state,
            submitted: Instant::new(&job.created_at),
            took: job.duration_seconds.map(text::duration).unwrap_or_default(),
            waits_for: job.waits_for.clone().unwrap_or_default(),
            settled: job.state.is_final(),
            can_retry: matches!(job.state, JobState::Failed | JobState::Cancelled),
            error: job.error.clone().unwrap_or_default(),
            progress: Bar::of(job.state, &job.progress),
            pipelines: pipelines(job),
        }
    }
}

/// The pipelines that a job belongs to.
pub fn pipelines(job: &Job) -> Vec<Link> {
    let link = |of: &Membership| Link {
        href: format!("/jobs/{}", of.id),
        label: format!("{} / {}", of.name, of.member),
    };
    job.pipelines.iter().map(link).collect()
}

/// Lines to copy, all for the shell or all for Python.
pub struct Snippet {
    pub title: &'static str,
    pub text: String,
}

/// Parts of commands to copy.
pub struct Commands {
    /// `curl` with the options that this server requires.
    pub curl: String,
    /// The address with which the reader reached the server.
    pub origin: String,
}

impl Commands {
    pub fn new(headers: &HeaderMap) -> Self {
        let text = |name: &str| headers.get(name).and_then(|value| value.to_str().ok());
        let host = text(HOST.as_str());
        // A proxy may say how its clients reach it. A client that says so changes its own page.
        let scheme = if text("x-forwarded-proto") == Some("https") { "https" } else { "http" };
        let prefix = text("x-forwarded-prefix").unwrap_or_default().trim_end_matches('/');
        let curl = if access::asked_for_a_token() {
            "curl -H \"Authorization: Bearer $TORQUED_TOKEN\""
        } else {
            "curl"
        };
        Self {
            curl: curl.to_owned(),
            origin: format!("{scheme}://{}{prefix}", host.unwrap_or("127.0.0.1:7070")),
        }
    }

    /// Commands that save all files of a dataset or a checkpoint in a folder of its name: the program's, and one without it.
    pub fn download(&self, kind: &str, id: i64) -> Snippet {
        let Self { curl, origin } = self;
        let text = format!(
            "torqued download {kind} {id} --server {origin}  # into {kind}-{id}, every digest compared\n\
             {curl} -s {origin}/v1/{kind}s/{id}/tar | tar -x  # the same without torqued"
        );
        Snippet { title: "Download", text }
    }
}
