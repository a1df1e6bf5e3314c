//! The demand for workers: tasks that wait, and why they wait.

use std::collections::HashMap;

use spec::{Moment, Resources};

use crate::boxed;
use crate::database::sql;
use crate::queue::rules::placement::{Placement, placement};
use crate::{JobId, Store, StoreError, Worker};

/// Waiting tasks that ask for the same resources.
#[derive(Clone, Debug, PartialEq)]
pub struct Demand {
    pub resources: Resources,
    /// Number of tasks that may be claimed now.
    pub waiting: u64,
}

/// Why queued tasks wait, besides waiting for their turn.
#[derive(Clone, Debug, PartialEq)]
pub enum Wait {
    /// They may not begin before this moment.
    Until(Moment),
    /// No live worker offers the resources that they ask for.
    Unoffered(Resources),
    /// Only these workers offer the resources, and they are drained.
    Drained { resources: Resources, workers: Vec<String> },
}

impl Store {
    /// The tasks that may be claimed now, grouped by the resources they ask for, in the order of
    /// the queue. There are none while the queue is paused.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn demand(&self) -> Result<Vec<Demand>, StoreError> {
        sql!(self.database(), "reading what tasks ask for", demand())
    }

    /// Why the queued tasks of `jobs` wait, where it is not only for their turn.
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

    /// Why the first task in line waits, if no live worker could take any waiting task.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn why_all_wait(&self) -> Result<Option<Wait>, StoreError> {
        let workers = self.workers().await?;
        let demand = self.demand().await?;
        let waits: Option<Vec<Wait>> = demand
            .into_iter()
            .map(|demanded| Wait::for_workers(demanded.resources, &workers))
            .collect();
        Ok(waits.and_then(|waits| waits.into_iter().next()))
    }
}

impl Wait {
    /// `None` if one of `workers` could take the tasks.
    fn for_workers(resources: Resources, workers: &[Worker]) -> Option<Self> {
        match placement(&resources, workers) {
            Placement::Possible => None,
            Placement::Drained(workers) => Some(Self::Drained { resources, workers }),
            Placement::Nowhere => Some(Self::Unoffered(resources)),
        }
    }
}
