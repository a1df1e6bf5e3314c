//! The health of the server.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The answer of a server that works.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Health {
    #[schema(example = "ok")]
    pub status: String,
    /// The version of torqued.
    pub version: String,
    /// Version of the database's schema.
    pub database_schema: i64,
}
