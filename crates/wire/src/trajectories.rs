//! Single trajectories of a dataset.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

/// One trajectory: its robot, and its channels over time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Trajectory {
    /// The id of the dataset.
    pub dataset: i64,
    /// Its index in the dataset.
    pub trajectory: u64,
    /// The shard that holds it.
    pub shard: u32,
    /// Samples per second.
    pub rate_hz: f64,
    /// Number of samples.
    pub samples: u64,
    /// The time of each sample, counted from the first one.
    pub time_s: Vec<f64>,
    /// One value per sample: torques `u1`, `u2`, …, positions `q1`, `q2`, …, and all other recorded
    /// channels. A value that is not a number is `null`.
    #[schema(value_type = BTreeMap<String, Vec<Option<f64>>>)]
    pub columns: BTreeMap<String, Vec<Option<f32>>>,
    /// Units of the columns. Columns that are not listed have none.
    pub units: BTreeMap<String, String>,
    /// Its row in the other table. For a simulation, it has everything that determines the
    /// trajectory; `dataset.json` explains the columns. For an import, it says where in the file
    /// the trajectory comes from.
    pub robot: Map<String, Value>,
}
