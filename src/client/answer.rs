//! The server's answers, as far as the command line reads them.

use std::collections::BTreeMap;
use std::fmt;

use evaluation::Report;
use serde::Deserialize;
use serde_json::Value;

#[derive(Clone, Debug, Deserialize)]
pub struct JobList {
    pub jobs: Vec<Job>,
    pub next: Option<i64>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct Job {
    pub id: i64,
    pub kind: String,
    #[serde(default)]
    pub name: Option<String>,
    pub state: JobState,
    #[serde(default)]
    pub error: Option<String>,
    pub digest: String,
    /// What of the spec is doubtful, though it is allowed.
    #[serde(default)]
    pub warnings: Vec<String>,
    pub progress: Progress,
    #[serde(default)]
    pub members: Vec<Member>,
    #[serde(default)]
    pub dataset: Option<i64>,
    /// The record of what it computed.
    #[serde(default)]
    pub run: Option<i64>,
    #[serde(default)]
    pub checkpoints: Vec<i64>,
    pub created_at: String,
    #[serde(default)]
    pub started_at: Option<String>,
    #[serde(default)]
    pub finished_at: Option<String>,
    /// From start to end.
    #[serde(default)]
    pub duration_seconds: Option<f64>,
}

impl Job {
    /// Why it did not succeed: its own reason, else that of its members.
    pub fn reason(&self) -> String {
        let members = self.members.iter().filter(|member| member.state == JobState::Failed);
        let reasons: Vec<String> = members
            .filter_map(|member| Some(format!("{}: {}", member.name, member.error.as_ref()?)))
            .collect();
        match (reasons.is_empty(), &self.error) {
            (true, Some(error)) => error.clone(),
            (true, None) => "no reason given".to_owned(),
            (false, _) => reasons.join("; "),
        }
    }
}

/// A job of a pipeline, seen from the pipeline.
#[derive(Clone, Debug, Deserialize)]
pub struct Member {
    pub name: String,
    pub job: i64,
    pub state: JobState,
    #[serde(default)]
    pub error: Option<String>,
    pub progress: Progress,
    /// Its results existed before the pipeline was submitted.
    #[serde(default)]
    pub reused: bool,
}

/// How much of a job is done, in units of its kind.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct Progress {
    #[serde(default)]
    pub done: f64,
    #[serde(default)]
    pub total: f64,
    #[serde(default)]
    pub unit: Option<String>,
    #[serde(default)]
    pub rate_per_second: Option<f64>,
    #[serde(default)]
    pub message: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum JobState {
    Waiting,
    Queued,
    Running,
    Succeeded,
    Failed,
    Cancelled,
}

impl JobState {
    /// Nothing will change any more.
    pub const fn is_final(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }
}

impl fmt::Display for JobState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Waiting => "waiting",
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        })
    }
}

#[derive(Clone, Debug, Deserialize)]
pub struct PresetList {
    pub presets: Vec<Preset>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct Preset {
    pub name: String,
    pub about: String,
    pub place: String,
    pub spec: Value,
}

#[derive(Clone, Debug, Deserialize)]
pub struct Dataset {
    pub trajectories: u64,
    pub bytes: u64,
}

#[derive(Clone, Debug, Deserialize)]
pub struct Checkpoint {
    pub step: u64,
    #[serde(default)]
    pub metrics: BTreeMap<String, f64>,
    #[serde(default)]
    pub files: Vec<StoredFile>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct StoredFile {
    pub name: String,
    pub sha256: String,
}

#[derive(Clone, Debug, Deserialize)]
pub struct Evaluation {
    pub report: Option<Report>,
    #[serde(default)]
    pub artifacts: Vec<Artifact>,
}

/// A file that a run left.
#[derive(Clone, Debug, Deserialize)]
pub struct Artifact {
    pub name: String,
    /// Path of the download.
    pub url: String,
}
