use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;
use utoipa::ToSchema;

/// One reason why a spec was refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Violation {
    /// Path of the field, e.g. `excitation.multisine.frequency_hz`. Empty for the whole spec.
    pub field: String,
    /// The offending value, as JSON.
    pub value: String,
    /// The values that are allowed.
    pub allowed: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let field = if self.field.is_empty() { "the spec" } else { &self.field };
        if self.value.is_empty() {
            write!(f, "{field}: {}", self.allowed)
        } else {
            write!(f, "{field} is {}, allowed: {}", self.value, self.allowed)
        }
    }
}

/// A spec was refused, for all these reasons.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub struct SpecError {
    pub violations: Vec<Violation>,
}

impl SpecError {
    pub fn one(
        field: impl Into<String>,
        value: impl Into<String>,
        allowed: impl Into<String>,
    ) -> Self {
        Self {
            violations: vec![Violation {
                field: field.into(),
                value: value.into(),
                allowed: allowed.into(),
            }],
        }
    }

    /// The same violations, with the fields as seen from an enclosing spec.
    pub fn within(mut self, outer: &str) -> Self {
        for violation in &mut self.violations {
            violation.field = match violation.field.as_str() {
                "" => outer.to_owned(),
                inner => format!("{outer}.{inner}"),
            };
        }
        self
    }
}

impl fmt::Display for SpecError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, violation) in self.violations.iter().enumerate() {
            if i > 0 {
                f.write_str("; ")?;
            }
            write!(f, "{violation}")?;
        }
        Ok(())
    }
}
