//! Counts of an import: trajectories made, recordings and samples dropped.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Counts in the result of an import's task, under `import`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ImportCounts {
    pub rows: u64,
    pub recordings: u64,
    /// Recordings that were too short for a trajectory.
    pub dropped_recordings: u64,
    pub trajectories: u64,
    /// Samples at the dataset's rate that are not part of any trajectory.
    pub dropped_samples: u64,
}
