//! The demand of tasks that wait, and why they wait.

use std::collections::HashMap;

use spec::{Moment, Resources};

use crate::boxed;
use crate::database::sql;
use crate::rules::placement::{Placement, placement};
use crate::{JobId, Store, StoreError, Worker};

/// Tasks that wait for a worker and ask for the same.
#[derive(Clone, Debug, PartialEq)]
pub struct Demand {
    pub resources: Resources,
    /// How many may be claimed now.
    pub waiting: u64,
}

/// Why queued tasks wait, if it is not only for their turn.
#[derive(Clone, Debug, PartialEq)]
pub enum Wait {
    /// They may not begin before.
    Until(Moment),
    /// No worker that is alive offers what they ask for.
    Unoffered(Resources),
    /// Only these workers do, and are drained.
    Drained { resources: Resources, workers: Vec<String> },
}

impl Store {
    /// The tasks that may be claimed now, by what they ask for, those first in line first; none while the queue is paused.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn demand(&self) -> Result<Vec<Demand>, StoreError> {
        sql!(self.database(), "reading what tasks ask for", demand())
    }

    /// Why the queued tasks of `jobs` wait, as far as there is more to it than their turn.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn waits(&self, jobs: &[JobId]) -> Result<HashMap<JobId, Wait>, StoreError> {
        let asked = sql!(self.database(), "reading what jobs wait for", asked_by(jobs))?;
        if asked.is_empty() {
            return Ok(HashMap::new());
        }
        let workers = self.workers().await?;
        let wait = |(job, resources, begins_at): (JobId, Resources, Option<Moment>)| {
            let wait = match begins_at {
                Some(moment) => Wait::Until(moment),
                None => Wait::for_workers(resources, &workers)?,
            };
            Some((job, wait))
        };
        Ok(asked.into_iter().filter_map(wait).collect())
    }

    /// Why the first task in line waits, if no worker that is alive could take any task that waits.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn why_all_wait(&self) -> Result<Option<Wait>, StoreError> {
        let workers = self.workers().await?;
        let demand = self.demand().await?;
        let waits: Option<Vec<Wait>> =
            demand.into_iter().map(|it| Wait::for_workers(it.resources, &workers)).collect();
        Ok(waits.and_then(|waits| waits.into_iter().next()))
    }
}

impl Wait {
    /// `None` where one of `workers` could take the tasks.
    fn for_workers(resources: Resources, workers: &[Worker]) -> Option<Self> {
        match placement(&resources, workers) {
            Placement::Possible => None,
            Placement::Drained(workers) => Some(Self::Drained { resources, workers }),
            Placement::Nowhere => Some(Self::Unoffered(resources)),
        }
    }
}
