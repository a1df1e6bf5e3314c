//! The body of every error: RFC 9457 problem details.

use serde::{Deserialize, Serialize};
use spec::Violation;
use utoipa::ToSchema;

use crate::Dependent;

/// An error: what was wrong, where, and what is allowed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// The type of the problem. It stays the same when its wording changes.
    #[serde(rename = "type")]
    pub kind: String,
    /// The type in words.
    pub title: String,
    /// The HTTP status of the answer.
    pub status: u16,
    /// Says what was wrong with this request, and what is allowed.
    pub detail: String,
    /// The fields of the spec that were refused, 100 at most.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub violations: Vec<Violation>,
    /// Number of violations that the list leaves out.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub more_violations: usize,
    /// The jobs that depend on the item to be deleted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub dependents: Vec<Dependent>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_zero(number: &usize) -> bool {
    *number == 0
}
