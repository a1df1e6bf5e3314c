//! Checkpoints and their files.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use spec::Digest;
use utoipa::ToSchema;

use crate::{List, Listed, Sort};

/// The weights of a model after some steps of training, with everything that is needed to resume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Checkpoint {
    pub id: i64,
    /// The training.
    pub job: i64,
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
    #[schema(example = "robomorph")]
    pub architecture: String,
    pub files: Vec<StoredFile>,
    pub created_at: String,
}

impl Listed for Checkpoint {
    const LIST: List = List {
        name: "checkpoints",
        kinds: &[],
        only: None,
        states: &[],
        sorts: &[Sort::Created, Sort::Step, Sort::Rmse],
    };
}

/// A page of checkpoints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Checkpoints {
    pub checkpoints: Vec<Checkpoint>,
    /// The `cursor` of the following page; `null` on the last one.
    pub next: Option<String>,
}

/// A file that can be downloaded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StoredFile {
    pub name: String,
    /// Size in bytes.
    pub size: u64,
    pub sha256: Digest,
    /// Path of the download.
    pub url: String,
}
