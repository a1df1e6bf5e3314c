use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::{Moment, Resources};

/// How a job is executed. It cannot change any result, so it is not part of the digest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Execution {
    /// Higher goes first, -100 to 100. One point is worth one hour of waiting.
    pub priority: i32,
    /// Number of times that a task may be claimed before it fails, 1 to 20.
    pub max_attempts: u32,
    /// Time limit of an attempt at a task in seconds, 1 to 2 592 000 (30 days). `null` uses the
    /// server's limit for this kind of job. A task that takes longer fails and is not retried.
    pub time_limit_s: Option<u32>,
    /// The resources that a worker must offer to take a task of the job.
    pub resources: Resources,
    /// No task begins before this time, by the database's clock. At most 366 days ahead.
    pub not_before: Option<Moment>,
}

const LONGEST_S: u32 = 30 * 24 * 60 * 60;

impl Default for Execution {
    fn default() -> Self {
        Self {
            priority: 0,
            max_attempts: 3,
            time_limit_s: None,
            resources: Resources::default(),
            not_before: None,
        }
    }
}

impl Execution {
    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

impl Check for Execution {
    fn check(&self, violations: &mut Violations) {
        violations.within("priority", self.priority, -100..=100);
        violations.within("max_attempts", self.max_attempts, 1..=20);
        if let Some(seconds) = self.time_limit_s {
            violations.within("time_limit_s", seconds, 1..=LONGEST_S);
        }
        violations.part("resources", &self.resources);
    }
}
