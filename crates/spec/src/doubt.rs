//! Warnings about values that are allowed.

use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A warning about a value that is allowed. A reader of the results should know about it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Doubt {
    /// Path of the field.
    pub field: String,
    /// The value.
    pub value: String,
    /// Why the value is doubtful, with numbers, and what to do about it.
    pub reason: String,
}

impl Doubt {
    /// The same warning about a spec at `path` in another one.
    #[must_use]
    pub fn within(self, path: &str) -> Self {
        Self { field: format!("{path}.{}", self.field), ..self }
    }
}

/// Displays the warning as a sentence.
impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { field, value, reason } = self;
        write!(f, "{field} is {value}: {reason}")
    }
}
