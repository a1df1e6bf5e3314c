//! The body of every error: RFC 9457 problem details.

use serde::{Deserialize, Serialize};
use spec::Violation;
use utoipa::ToSchema;

use crate::Dependent;

/// An error: the fault, its place, and what is allowed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// The kind of problem; it stays the same when its words change.
    #[serde(rename = "type")]
    pub kind: String,
    /// The kind in words.
    pub title: String,
    pub status: u16,
    /// The fault of this request, and what is allowed.
    pub detail: String,
    /// Every field of a spec that cannot be accepted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub violations: Vec<Violation>,
    /// The jobs that depend on what was to be deleted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub dependents: Vec<Dependent>,
}
