//! Checkpoints and their files.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use spec::Digest;
use utoipa::ToSchema;

/// Weights of a model after some steps of training, with everything to resume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Checkpoint {
    pub id: i64,
    /// The training.
    pub job: i64,
    pub run: i64,
    /// As somebody calls it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// A note in Markdown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Its tags, in order.
    #[serde(default)]
    pub tags: Vec<String>,
    /// Those of its job, in order; it is found by them, too.
    #[serde(default)]
    pub job_tags: Vec<String>,
    /// Optimizer steps taken.
    pub step: u64,
    /// True of the checkpoint that training ended with.
    #[serde(rename = "final")]
    pub is_final: bool,
    /// True of the checkpoint with the best validation so far, by the training's `monitor`.
    #[serde(rename = "best")]
    pub is_best: bool,
    /// True of the newest checkpoint of its training.
    #[serde(rename = "last")]
    pub is_last: bool,
    /// Newest values when it was written, `validation/rmse_deg` among them once there was one.
    pub metrics: BTreeMap<String, f64>,
    /// The digest of the training's spec.
    pub digest: Digest,
    #[schema(example = "robomorph")]
    pub architecture: String,
    pub files: Vec<StoredFile>,
    pub created_at: String,
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
