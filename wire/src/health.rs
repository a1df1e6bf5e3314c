//! The health of the server.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The answer of a server whose database can be written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Health {
    /// `ok`, or `degraded` where requests are answered but no task is executed.
    #[schema(example = "ok")]
    pub status: String,
    /// Why tasks wait, if the status is `degraded`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reasons: Vec<String>,
    /// The version of torqued.
    pub version: String,
    /// Version of the database's schema.
    pub database_schema: i64,
    /// Workers that are alive.
    pub workers: usize,
    /// Room on the disk of the data folder.
    pub free_bytes: u64,
}

/// The answer of a server that requests should be sent to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Readiness {
    #[schema(example = "ready")]
    pub status: String,
}
