//! Counts of an import: trajectories made, recordings and samples dropped. Warnings about its
//! recordings.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Counts in the result of an import's task, under `import`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ImportCounts {
    /// Rows of the file.
    pub rows: u64,
    /// Recordings in the file.
    pub recordings: u64,
    /// Recordings that were too short for a trajectory.
    pub dropped_recordings: u64,
    /// Trajectories of the dataset.
    pub trajectories: u64,
    /// Samples at the dataset's rate that are not part of any trajectory.
    pub dropped_samples: u64,
    /// Rows that repeat the time of the row before, and were left out.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub repeated_rows: u64,
    /// Recordings that passed the low-pass because they are faster than the dataset.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub filtered_recordings: u64,
    /// What was left out, and suspicious values that may be right: a sentence each, at most one for
    /// each joint.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_zero(count: &u64) -> bool {
    *count == 0
}
