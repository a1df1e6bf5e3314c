//! The health of the server.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The answer of a server that can write to its database.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Health {
    /// `ok`, or `degraded` if requests are answered but no tasks are executed.
    #[schema(example = "ok")]
    pub status: String,
    /// Why tasks wait, if the status is `degraded`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reasons: Vec<String>,
    /// The version of torqued.
    pub version: String,
    /// Version of the database's schema.
    pub database_schema: i64,
    /// Number of live workers.
    pub workers: usize,
    /// Free space on the disk of the data folder.
    pub free_bytes: u64,
}

/// The answer of a server that is ready for requests.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Readiness {
    /// Always `ready`.
    #[schema(example = "ready")]
    pub status: String,
}
