//! The demand for workers: tasks that wait, and why they wait.

use std::collections::HashMap;

use spec::{Moment, Resources};

use crate::database::column::json;
use crate::database::query::{Query, Row, from_row, sql};
use crate::database::rows::{moment, resources, text_of_tags};
use crate::database::{Reading, Transaction};
use crate::identifiers::ResourcesId;
use crate::queue::rules::placement::{Placement, placement};
use crate::queue::statements::line::may_be_claimed;
use crate::{JobId, Store, StoreError, Worker, boxed};

/// Waiting tasks that ask for the same resources.
#[derive(Clone, Debug, PartialEq)]
pub struct Demand {
    /// The resources that a worker must offer.
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
    Drained {
        /// The resources.
        resources: Resources,
        /// The names of the workers.
        workers: Vec<String>,
    },
}

impl Store {
    /// The tasks that may be claimed now, grouped by the resources they ask for, in the order of
    /// the queue. There are none while the queue is paused.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn demand(&self) -> Result<Vec<Demand>, StoreError> {
        self.read("reading what tasks ask for").demand().await
    }

    /// Why the queued tasks of `jobs` wait, where it is not only for their turn.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn waits(&self, jobs: &[JobId]) -> Result<HashMap<JobId, Wait>, StoreError> {
        let asked = self.read("reading what jobs wait for").asked_by(jobs).await?;
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

impl Reading<'_> {
    /// The tasks that may be claimed, grouped by the resources they ask for, in the order of the
    /// queue.
    pub async fn demand(&mut self) -> Result<Vec<Demand>, StoreError> {
        sql(demand()).all(self).await
    }

    /// Jobs with queued tasks that ask for resources or may not begin yet, with these resources and
    /// the start time.
    pub async fn asked_by(
        &mut self,
        jobs: &[JobId],
    ) -> Result<Vec<(JobId, Resources, Option<Moment>)>, StoreError> {
        let rows =
            sql("SELECT job.id AS job, asked.cpus, asked.gpus, asked.memory_mb, asked.tags, \
             CASE WHEN job.not_before > {now} THEN job.not_before ELSE 0 END AS begins_at \
             FROM job JOIN resources AS asked ON asked.id = job.resources \
             WHERE job.id IN {ids $1} AND job.state IN ('queued', 'running') AND (asked.cpus > 0 \
             OR asked.gpus > 0 OR asked.memory_mb > 0 OR asked.tags <> '[]' \
             OR job.not_before > {now}) AND EXISTS (SELECT 1 FROM task WHERE task.job = job.id \
             AND task.state = 'queued')")
            .bind(json(&jobs))
            .rows(self)
            .await?;
        let read = |row: &Row| Ok((row.get("job")?, resources(row)?, moment(row, "begins_at")?));
        rows.iter().map(read).collect()
    }
}

impl Transaction {
    /// The id of a combination of resources. Inserts it if it is new.
    pub async fn resources_id(&mut self, asked: &Resources) -> Result<ResourcesId, StoreError> {
        if let Some(id) = find_resources(asked).optional(self).await? {
            return Ok(id);
        }
        sql("INSERT INTO resources (cpus, gpus, memory_mb, tags) VALUES ($1, $2, $3, $4) \
             ON CONFLICT (cpus, gpus, memory_mb, tags) DO NOTHING")
        .bind(asked.cpus.unwrap_or(0))
        .bind(asked.gpus)
        .bind(asked.megabytes())
        .bind(text_of_tags(&asked.tags))
        .run(self)
        .await?;
        find_resources(asked).one(self).await
    }
}

fn find_resources(asked: &Resources) -> Query {
    sql("SELECT id FROM resources WHERE cpus = $1 AND gpus = $2 AND memory_mb = $3 AND tags = $4")
        .bind(asked.cpus.unwrap_or(0))
        .bind(asked.gpus)
        .bind(asked.megabytes())
        .bind(text_of_tags(&asked.tags))
}

fn demand() -> String {
    format!(
        "SELECT asked.cpus, asked.gpus, asked.memory_mb, asked.tags, found.waiting \
         FROM (SELECT resources, COUNT(*) AS waiting, MIN(turn) AS turn FROM task WHERE {} \
               GROUP BY resources) AS found \
         JOIN resources AS asked ON asked.id = found.resources ORDER BY found.turn, asked.id",
        may_be_claimed("{now}")
    )
}

from_row!(Demand { waiting, ..row => resources: resources(row)? });
