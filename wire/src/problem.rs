//! The body of every error: RFC 9457 problem details.

use serde::{Deserialize, Serialize};
use spec::Violation;
use utoipa::ToSchema;

/// What was wrong, where, and what is allowed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// Names the kind of problem and stays the same when its words change.
    #[serde(rename = "type")]
    pub kind: String,
    /// The kind in words.
    pub title: String,
    pub status: u16,
    /// What was wrong with this request, and what is allowed.
    pub detail: String,
    /// For specs: every field that cannot be accepted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub violations: Vec<Violation>,
}
