//! Runs: the records of trainings, evaluations and control jobs.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::{Digest, JobKind, JobSpec, ValidationMetric};
use utoipa::ToSchema;

use crate::lists::all_tags;
use crate::{JobState, List, ListCell, ListColumn, Listed, Runs, Sort, Tabled};

/// The record of a training, an evaluation or a control job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Run {
    /// The id that paths and commands refer to it by.
    pub id: i64,
    /// The id of its job.
    pub job: i64,
    /// The kind of its job: `train`, `evaluate` or `control`.
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
    /// The digest of its job's spec.
    pub digest: Digest,
    /// The state of its job.
    pub state: JobState,
    /// Why the job failed or was cancelled.
    pub error: Option<String>,
    /// The spec of its job.
    #[schema(value_type = JobSpec)]
    pub spec: Value,
    /// The names of the data that its job reads, separated by commas. Robots that are simulated
    /// as they are needed are called `stream`. Missing without data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data: Option<String>,
    /// The latest value of each metric, by key.
    pub metrics: BTreeMap<String, LatestMetric>,
    /// Its files, besides those of checkpoints.
    pub artifacts: Vec<Artifact>,
    /// When it was created.
    pub created_at: String,
}

/// The last recorded value of a metric.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LatestMetric {
    /// The step at which it was recorded.
    pub step: u64,
    /// `null` if the value was not finite.
    #[schema(required)]
    pub value: Option<f64>,
}

/// The name by which commands and pages refer to a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RunName {
    /// The id of a run of torqued.
    Own(i64),
    /// The identifier of a run that a client of MLflow logged: 32 hexadecimal digits.
    Logged(String),
}

impl FromStr for RunName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let is_identifier = text.len() == 32 && text.chars().all(|c| c.is_ascii_hexdigit());
        if is_identifier {
            return Ok(Self::Logged(text.to_ascii_lowercase()));
        }
        text.parse().map(Self::Own).map_err(|_| {
            "allowed: the id of a run, or the 32 hexadecimal digits of a run that was logged"
                .to_owned()
        })
    }
}

impl Display for RunName {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Own(id) => Display::fmt(id, f),
            Self::Logged(identifier) => f.write_str(identifier),
        }
    }
}

/// A file that a run left.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Artifact {
    /// The name of the file.
    pub name: String,
    /// Its type, as in `Content-Type`.
    pub media_type: String,
    /// Size in bytes.
    pub size: u64,
    /// SHA-256 of its bytes.
    pub sha256: Digest,
    /// Path of the download.
    pub url: String,
}

impl Tabled for Run {
    const COLUMNS: &'static [ListColumn<Self>] = &[
        ListColumn::words("kind", |run| ListCell::text(run.kind)),
        ListColumn::words("state", |run| ListCell::state(run.state)),
        ListColumn::number("step", |run| {
            let steps = run.metrics.values().map(|metric| metric.step);
            ListCell::some(steps.max(), ListCell::Count)
        }),
        ListColumn::number("last validation RMSE", |run| {
            let latest = run.metrics.get(ValidationMetric::RmseDeg.key());
            ListCell::some(latest.and_then(|metric| metric.value), ListCell::Degrees)
        }),
        ListColumn::words("data", |run| ListCell::some(run.data.clone(), ListCell::Text)),
        ListColumn::number("job", |run| ListCell::text(run.job)),
        ListColumn::number("created", |run| ListCell::moment(&run.created_at)),
    ];
}

impl Listed for Run {
    const LIST: List = List {
        name: "runs",
        empty: "A training, an evaluation or a control job makes a run.",
        kinds: JobKind::WORDS,
        only: None,
        states: &JobState::WORDS,
        sorts: &[Sort::Created, Sort::Finished, Sort::Name, Sort::Rmse],
        has_labels: true,
        has_columns: true,
    };

    type Page = Runs;

    fn id(&self) -> i64 {
        self.id
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn tags(&self) -> Vec<&str> {
        all_tags(&self.tags, &self.job_tags)
    }

    fn chosen(&self, column: &str) -> ListCell {
        match self.metrics.get(column) {
            Some(latest) => ListCell::some(latest.value, ListCell::Number),
            None => ListCell::at(&self.spec, column),
        }
    }
}

/// A metric over steps, downsampled to the requested number of points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Metric {
    /// The metric's name, e.g. `train/loss`.
    pub key: String,
    /// The points, sorted by step.
    pub points: Vec<MetricPoint>,
    /// Number of points before downsampling.
    pub recorded: u64,
}

/// A value of a metric.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MetricPoint {
    /// The step at which it was recorded.
    pub step: u64,
    /// When it was recorded.
    pub time: String,
    /// `null` if the value was not finite.
    #[schema(required)]
    pub value: Option<f64>,
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_run_is_named_by_its_id_or_by_its_identifier() {
        let identifier = "0123456789abcdef0123456789ABCDEF";
        assert_eq!("7".parse(), Ok(RunName::Own(7)));
        assert_eq!(identifier.parse(), Ok(RunName::Logged(identifier.to_ascii_lowercase())));
        for text in ["", "seven", "7.5", &identifier[1..]] {
            assert!(text.parse::<RunName>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_chosen_column_is_a_metric_or_a_field_of_the_spec() {
        let run: Run = serde_json::from_value(json!({
            "id": 1, "job": 2, "kind": "train", "name": "train", "digest": "0".repeat(64),
            "state": "succeeded", "error": null, "artifacts": [], "created_at": "2026-11-28T12:00:00Z",
            "spec": {"optimizer": {"learning_rate": 0.01}, "model": {"architecture": "cdt"}, "betas": [1, 2]},
            "metrics": {"train/loss": {"step": 10, "value": 0.25}, "nan": {"step": 1, "value": null}},
        }))
        .unwrap();
        for (column, cell) in [
            ("train/loss", ListCell::Number(0.25)),
            ("nan", ListCell::Missing),
            ("optimizer.learning_rate", ListCell::Number(0.01)),
            ("model.architecture", ListCell::Text("cdt".to_owned())),
            ("betas", ListCell::Text("[1,2]".to_owned())),
            ("betas.x", ListCell::Missing),
            ("nothing", ListCell::Missing),
        ] {
            assert_eq!(run.chosen(column), cell, "{column}");
        }
    }
}
