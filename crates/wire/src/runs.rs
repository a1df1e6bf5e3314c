//! Runs: the records of trainings, evaluations and control jobs.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::{Digest, JobKind, JobSpec};
use utoipa::ToSchema;

use crate::{JobState, List, Listed, Sort};

/// The record of a training, an evaluation or a control job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Run {
    pub id: i64,
    pub job: i64,
    pub kind: JobKind,
    /// The name that users gave it, or the name of its job.
    pub name: String,
    /// A note in Markdown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Its tags, sorted.
    #[serde(default)]
    pub tags: Vec<String>,
    /// Tags of its job, sorted. Lists also find it by these.
    #[serde(default)]
    pub job_tags: Vec<String>,
    pub digest: Digest,
    pub state: JobState,
    pub error: Option<String>,
    #[schema(value_type = JobSpec)]
    pub spec: Value,
    /// The latest value of each metric, by key.
    pub metrics: BTreeMap<String, LatestMetric>,
    pub artifacts: Vec<Artifact>,
    pub created_at: String,
}

/// The last recorded value of a metric.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LatestMetric {
    pub step: u64,
    /// `null` if the value was not finite.
    #[schema(required)]
    pub value: Option<f64>,
}

/// A file that a run left.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Artifact {
    pub name: String,
    pub media_type: String,
    /// Size in bytes.
    pub size: u64,
    pub sha256: Digest,
    /// Path of the download.
    pub url: String,
}

impl Listed for Run {
    const LIST: List = List {
        name: "runs",
        kinds: JobKind::WORDS,
        only: None,
        states: &JobState::WORDS,
        sorts: &[Sort::Created, Sort::Finished, Sort::Name, Sort::Rmse],
    };
}

/// A page of runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Runs {
    pub runs: Vec<Run>,
    /// The `cursor` of the following page; `null` on the last one.
    pub next: Option<String>,
}

/// A metric over steps, downsampled to the requested number of points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Metric {
    pub key: String,
    /// The points, sorted by step.
    pub points: Vec<MetricPoint>,
    /// Number of points before downsampling.
    pub recorded: u64,
}

/// A value of a metric.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MetricPoint {
    pub step: u64,
    pub time: String,
    /// `null` if the value was not finite.
    #[schema(required)]
    pub value: Option<f64>,
}
