//! Verifications: datasets that are made again and compared with the stored files.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::JobState;

/// The result of comparing a dataset with the same trajectories made again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Verification {
    /// The id of the verification.
    pub job: i64,
    /// `succeeded` when nothing differs.
    pub state: JobState,
    /// Number of shards of the dataset.
    pub shards: u64,
    /// Number of shards that were compared and have the same values.
    pub shards_verified: u64,
    /// Number of those whose bytes are also the same.
    pub shards_identical: u64,
    /// Remarks on compared shards; only the first few.
    pub remarks: Vec<String>,
    /// The first difference, or the reason why the dataset could not be compared.
    pub error: Option<String>,
    /// When it ended. `null` before.
    pub finished_at: Option<String>,
}

/// The result of a verification's task: how a shard agrees with the same trajectories made again.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct VerifiedShard {
    /// The index of the shard, from 0.
    pub shard: u32,
    /// The id of the dataset.
    pub dataset: i64,
    /// `equal`, or a description of how the bytes differ, or of what they were compared with.
    pub bytes: String,
    /// A description of how the values agree if the bytes differ.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub values: Option<String>,
}
