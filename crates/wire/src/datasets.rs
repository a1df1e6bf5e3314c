//! Datasets and their files.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::{Digest, JobKind, JobSpec};
use utoipa::ToSchema;

use crate::lists::all_tags;
use crate::{
    DatasetState, Datasets, List, ListCell, ListColumn, Listed, Sort, Tabled, Verification,
};

/// Trajectories of robots, simulated or recorded, as Parquet files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Dataset {
    /// The id that specs, paths and commands refer to it by.
    pub id: i64,
    /// The simulation or import that fills it.
    pub job: i64,
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
    /// The digest of the job's spec.
    pub digest: Digest,
    /// Whether all of its shards exist.
    pub state: DatasetState,
    /// The spec of its job.
    #[schema(value_type = JobSpec)]
    pub spec: Value,
    /// Number of trajectories of the complete dataset; 0 for an import that has not ended.
    pub trajectories: u64,
    /// Number of samples of each trajectory.
    pub samples: u32,
    /// Draws refused so far.
    pub rejected: u64,
    /// Size of all files so far.
    pub bytes: u64,
    /// The files that exist so far. Empty in a list of datasets.
    pub files: Vec<DatasetFile>,
    /// The newest verification. Left out in a list of datasets.
    pub verification: Option<Verification>,
    /// When its job was submitted.
    pub created_at: String,
    /// When its last shard was written. `null` before.
    pub completed_at: Option<String>,
}

/// A file of a dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DatasetFile {
    /// The name of the file.
    pub name: String,
    /// The kind of content.
    pub content: FileKind,
    /// The shard of the file. Missing for `dataset.json`, which describes all shards.
    pub shard: Option<u32>,
    /// Number of rows, if it is a table.
    pub rows: Option<u64>,
    /// Size in bytes.
    pub size: u64,
    /// SHA-256 of its bytes.
    pub sha256: Digest,
    /// Path of the download.
    pub url: String,
}

/// The content of a file of a dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum FileKind {
    /// JSON that describes the dataset: columns with units and frames, counts, files with digests,
    /// the spec.
    Description,
    /// A table with one row per time step.
    Trajectories,
    /// A table with one row per trajectory.
    Robots,
}

impl Tabled for Dataset {
    const COLUMNS: &'static [ListColumn<Self>] = &[
        ListColumn::words("state", |dataset| {
            ListCell::State(dataset.state.colour(), dataset.state.as_str())
        }),
        ListColumn::number("trajectories", |dataset| ListCell::Count(dataset.trajectories)),
        ListColumn::number("samples", |dataset| ListCell::Count(dataset.samples.into())),
        ListColumn::number("size", |dataset| ListCell::Bytes(dataset.bytes)),
        ListColumn::number("job", |dataset| ListCell::text(dataset.job)),
        ListColumn::number("created", |dataset| ListCell::moment(&dataset.created_at)),
    ];
}

impl Listed for Dataset {
    const LIST: List = List {
        name: "datasets",
        empty: "A simulation or an import makes a dataset.",
        kinds: JobKind::WORDS,
        only: None,
        states: &DatasetState::WORDS,
        sorts: &[Sort::Created, Sort::Name, Sort::Trajectories],
        has_labels: true,
        has_columns: false,
    };

    type Page = Datasets;

    fn id(&self) -> i64 {
        self.id
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn tags(&self) -> Vec<&str> {
        all_tags(&self.tags, &self.job_tags)
    }
}
