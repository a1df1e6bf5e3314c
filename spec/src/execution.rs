use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Report};

/// How a job is run. Cannot change any result, so it is no part of the digest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Execution {
    /// Higher goes first, -100 to 100.
    pub priority: i32,
    /// Times a task may be claimed before it fails, 1 to 20.
    pub max_attempts: u32,
}

impl Default for Execution {
    fn default() -> Self {
        Self { priority: 0, max_attempts: 3 }
    }
}

impl Execution {
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

impl Check for Execution {
    fn check(&self, report: &mut Report) {
        report.within("priority", self.priority, -100..=100);
        report.within("max_attempts", self.max_attempts, 1..=20);
    }
}
