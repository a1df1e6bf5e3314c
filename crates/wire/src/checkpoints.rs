//! Checkpoints and their files.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use spec::{Digest, ValidationMetric};
use utoipa::ToSchema;

use crate::lists::all_tags;
use crate::{Checkpoints, List, ListCell, ListColumn, Listed, Sort, Tabled};

/// The weights of a model after some steps of training, with everything that is needed to resume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Checkpoint {
    /// The id that specs, paths and commands refer to it by.
    pub id: i64,
    /// The training that wrote it.
    pub job: i64,
    /// The run of that training.
    pub run: i64,
    /// The name that users gave it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// A note in Markdown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Its tags, sorted.
    #[serde(default)]
    pub tags: Vec<String>,
    /// Tags of its job, sorted. Lists also find it by these.
    #[serde(default)]
    pub job_tags: Vec<String>,
    /// Names that stand for this checkpoint alone, sorted. Paths, commands and specs take them in the place of its id.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub aliases: Vec<String>,
    /// Optimizer steps taken.
    pub step: u64,
    /// Whether the training ended with it.
    #[serde(rename = "final")]
    pub is_final: bool,
    /// Whether it has the best validation so far, measured by the training's `monitor`.
    #[serde(rename = "best")]
    pub is_best: bool,
    /// Whether it is the newest checkpoint of its training.
    #[serde(rename = "last")]
    pub is_last: bool,
    /// The newest metrics when it was written. They include `validation/rmse_deg` after the first
    /// validation.
    pub metrics: BTreeMap<String, f64>,
    /// The digest of the training's spec.
    pub digest: Digest,
    /// The kind of the model in the training's spec.
    #[schema(example = "robomorph")]
    pub architecture: String,
    /// The names of the data that its training reads, separated by commas. Robots that are simulated
    /// as they are needed are called `stream`. Missing without data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data: Option<String>,
    /// Its weights, its configuration and, to resume the training, the state of the optimizer.
    pub files: Vec<StoredFile>,
    /// When it was written.
    pub created_at: String,
}

impl Checkpoint {
    /// Its marks among the checkpoints of its training, e.g. `best` and `final`.
    pub fn marks(&self) -> Vec<&'static str> {
        let marks = [
            (self.is_best, "best"),
            (self.is_final, "final"),
            (self.is_last && !self.is_final, "last"),
        ];
        marks.into_iter().filter_map(|(has, mark)| has.then_some(mark)).collect()
    }
}

impl Tabled for Checkpoint {
    const COLUMNS: &'static [ListColumn<Self>] = &[
        ListColumn::words("model", |checkpoint| ListCell::text(&checkpoint.architecture)),
        ListColumn::number("step", |checkpoint| ListCell::Count(checkpoint.step)),
        ListColumn::words("mark", |checkpoint| ListCell::Text(checkpoint.marks().join(", "))),
        ListColumn::words("alias", |checkpoint| ListCell::Text(checkpoint.aliases.join(", "))),
        ListColumn::number("validation RMSE", |checkpoint| {
            let rmse_deg = checkpoint.metrics.get(ValidationMetric::RmseDeg.key());
            ListCell::some(rmse_deg.copied(), ListCell::Degrees)
        }),
        ListColumn::words("data", |checkpoint| {
            ListCell::some(checkpoint.data.clone(), ListCell::Text)
        }),
        ListColumn::number("size", |checkpoint| {
            ListCell::Bytes(checkpoint.files.iter().map(|file| file.size).sum())
        }),
        ListColumn::number("job", |checkpoint| ListCell::text(checkpoint.job)),
        ListColumn::number("created", |checkpoint| ListCell::moment(&checkpoint.created_at)),
    ];
}

impl Listed for Checkpoint {
    const LIST: List = List {
        name: "checkpoints",
        empty: "A training writes checkpoints.",
        kinds: &[],
        only: None,
        states: &[],
        sorts: &[Sort::Created, Sort::Step, Sort::Rmse],
        has_labels: true,
        has_columns: true,
    };

    type Page = Checkpoints;

    fn id(&self) -> i64 {
        self.id
    }

    fn name(&self) -> &str {
        self.name.as_deref().unwrap_or_default()
    }

    fn tags(&self) -> Vec<&str> {
        all_tags(&self.tags, &self.job_tags)
    }

    fn chosen(&self, column: &str) -> ListCell {
        ListCell::some(self.metrics.get(column).copied(), ListCell::Number)
    }
}

/// A file that can be downloaded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StoredFile {
    /// The name of the file.
    pub name: String,
    /// Size in bytes.
    pub size: u64,
    /// SHA-256 of its bytes.
    pub sha256: Digest,
    /// Path of the download.
    pub url: String,
}
