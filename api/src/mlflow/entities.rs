//! MLflow's entities as JSON of its `service.proto`. Integers of 64 bits are numbers, and doubles
//! that are not finite are words.

use serde::{Serialize, Serializer};

#[derive(Clone, Debug, Serialize)]
pub struct Experiment {
    pub experiment_id: String,
    pub name: String,
    pub artifact_location: String,
    pub lifecycle_stage: Stage,
    pub creation_time: i64,
    pub last_update_time: i64,
    pub tags: Vec<Pair>,
}

#[derive(Clone, Debug, Serialize)]
pub struct Run {
    pub info: RunInfo,
    pub data: RunData,
}

#[derive(Clone, Debug, Serialize)]
pub struct RunInfo {
    pub run_id: String,
    /// The same id, for older clients.
    pub run_uuid: String,
    pub run_name: String,
    pub experiment_id: String,
    pub user_id: String,
    pub status: &'static str,
    pub start_time: i64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end_time: Option<i64>,
    pub artifact_uri: String,
    pub lifecycle_stage: Stage,
}

#[derive(Clone, Debug, Default, Serialize)]
pub struct RunData {
    /// The latest point of each key.
    pub metrics: Vec<Metric>,
    pub params: Vec<Pair>,
    pub tags: Vec<Pair>,
}

#[derive(Clone, Debug, Serialize)]
pub struct Metric {
    pub key: String,
    #[serde(serialize_with = "double")]
    pub value: f64,
    /// Milliseconds since 1970.
    pub timestamp: i64,
    pub step: i64,
}

/// A param or a tag.
#[derive(Clone, Debug, Serialize)]
pub struct Pair {
    pub key: String,
    pub value: String,
}

/// A file or a folder of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FileInfo {
    pub path: String,
    pub is_dir: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file_size: Option<u64>,
}

/// Whether an experiment or a run is in the trash.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    Active,
    Deleted,
}

/// The stages that a search finds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    Active,
    Deleted,
    All,
}

impl Stage {
    pub const fn of(is_deleted: bool) -> Self {
        if is_deleted { Self::Deleted } else { Self::Active }
    }
}

impl View {
    pub const fn shows(self, is_deleted: bool) -> bool {
        match self {
            Self::Active => !is_deleted,
            Self::Deleted => is_deleted,
            Self::All => true,
        }
    }
}

impl From<(String, String)> for Pair {
    fn from((key, value): (String, String)) -> Self {
        Self { key, value }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands it over")]
fn double<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    if value.is_nan() {
        serializer.serialize_str("NaN")
    } else if value.is_infinite() {
        serializer.serialize_str(if *value > 0.0 { "Infinity" } else { "-Infinity" })
    } else {
        serializer.serialize_f64(*value)
    }
}
