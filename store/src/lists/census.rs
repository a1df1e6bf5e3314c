//! Counts of jobs, tasks and attempts, for the server's metrics.

use wire::{AttemptOutcome, JobState, TaskState};

use crate::boxed;
use crate::database::sql;
use crate::{Store, StoreError};

/// Counts by kind of job. Counts of zero are left out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Census {
    pub jobs: Vec<(String, JobState, u64)>,
    pub tasks: Vec<(String, TaskState, u64)>,
    /// Those of jobs that were deleted for good included; without an outcome, those that go on.
    pub attempts: Vec<(String, Option<AttemptOutcome>, u64)>,
}

impl Store {
    /// Counts all jobs, tasks and attempts. The time grows with their number: about 0.2 s for a
    /// million.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn census(&self) -> Result<Census, StoreError> {
        sql!(self.database(), "counting jobs, tasks and attempts", census())
    }
}
