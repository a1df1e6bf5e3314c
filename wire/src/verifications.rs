//! Verifications: datasets made again and compared with what is stored.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::JobState;

/// The outcome of comparing a dataset with the same trajectories made again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Verification {
    pub job: i64,
    /// `succeeded` when nothing differs.
    pub state: JobState,
    pub shards: u64,
    /// Shards that have been compared, without a difference in any value.
    pub shards_verified: u64,
    /// Those of them whose bytes are the same, to the last one.
    pub shards_identical: u64,
    /// Remarks on shards that were compared: the first few of them.
    pub remarks: Vec<String>,
    /// The first difference, or why the dataset could not be compared.
    pub error: Option<String>,
    pub finished_at: Option<String>,
}

/// The result of a verification's task: how a shard agrees with the same trajectories made again.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct VerifiedShard {
    pub shard: u32,
    pub dataset: i64,
    /// `equal`, or in words how the bytes differ or what they were compared with.
    pub bytes: String,
    /// The agreement of the values where the bytes differ.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub values: Option<String>,
}
