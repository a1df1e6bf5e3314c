//! The jobs that depend on the results of other jobs.

use wire::{ItemKind, Relation};

use crate::StoreError;
use crate::database::Transaction;
use crate::database::query::{Query, Row, sql};
use crate::trash::Reach;
use crate::trash::names::name_of;
use crate::trash::rules::Dependent;

/// Dependents, sorted by job. A job that has ended counts as long as a result of it exists that was
/// made with the item.
pub(crate) async fn of(tx: &mut Transaction, reach: &Reach) -> Result<Vec<Dependent>, StoreError> {
    let mut found: Vec<Dependent> = tx.readers(reach).await?;
    found.extend(tx.successors(reach).await?);
    if reach.whole {
        found.extend(tx.holders(reach).await?);
    }
    found.sort_by_key(|dependent| (dependent.job, dependent.relation));
    found.dedup_by_key(|dependent| dependent.job);
    Ok(found)
}

/// The condition that a job has not ended, or has left something that still exists.
const COUNTS: &str = " AND (job.state NOT IN ('succeeded', 'failed', 'cancelled') \
     OR EXISTS (SELECT 1 FROM dataset WHERE dataset.job = job.id AND dataset.deleted_at IS NULL) \
     OR EXISTS (SELECT 1 FROM run WHERE run.job = job.id AND run.deleted_at IS NULL))";

impl Transaction {
    /// Jobs whose specs name the digests, and jobs that need the jobs.
    pub async fn readers(&mut self, reach: &Reach) -> Result<Vec<Dependent>, StoreError> {
        let mut query = others(reach);
        query.push(COUNTS).push(" AND job.id IN (SELECT job FROM job_input WHERE digest IN ");
        query.push_texts(&reach.digests);
        query.push(")");
        let mut found = self.jobs_that(Relation::Reads, query).await?;
        let mut query = others(reach);
        query.push(COUNTS).push(" AND job.id IN (SELECT job FROM job_need WHERE needs IN ");
        push_jobs(&mut query, reach);
        query.push(")");
        found.extend(self.jobs_that(Relation::Needs, query).await?);
        Ok(found)
    }

    /// Later jobs of the same digests that copy the results of the jobs, or that have tasks with
    /// results of earlier tasks. No worker ever had such a task.
    pub async fn successors(&mut self, reach: &Reach) -> Result<Vec<Dependent>, StoreError> {
        let mut query = others(reach);
        query.push(" AND job.digest IN ").push_texts(&reach.digests);
        query.push(
            " AND EXISTS (SELECT 1 FROM job AS earlier WHERE earlier.digest = job.digest \
             AND earlier.id < job.id AND earlier.id IN ",
        );
        push_jobs(&mut query, reach);
        query.push(
            ") AND ((job.takes_over AND job.state NOT IN ('succeeded', 'failed', 'cancelled')) \
             OR EXISTS (SELECT 1 FROM task WHERE task.job = job.id AND task.state = 'succeeded' \
                 AND task.attempt = 0))",
        );
        query.push(COUNTS);
        self.jobs_that(Relation::Continues, query).await
    }

    /// Pipelines with the jobs as members.
    pub async fn holders(&mut self, reach: &Reach) -> Result<Vec<Dependent>, StoreError> {
        let mut query = others(reach);
        query.push(" AND job.id IN (SELECT pipeline FROM pipeline_member WHERE job IN ");
        push_jobs(&mut query, reach);
        query.push(")");
        self.jobs_that(Relation::Holds, query).await
    }

    async fn jobs_that(
        &mut self,
        relation: Relation,
        query: Query,
    ) -> Result<Vec<Dependent>, StoreError> {
        let rows = query.rows(self).await?;
        let dependent = |row: &Row| {
            Ok(Dependent {
                job: row.get("id")?,
                kind: row.get("kind")?,
                name: row.get("name")?,
                state: row.get("state")?,
                relation,
                digest: row.get("digest")?,
            })
        };
        rows.iter().map(dependent).collect()
    }
}

fn others(reach: &Reach) -> Query {
    let name = name_of(ItemKind::Job, "job");
    let mut query = sql(format!(
        "SELECT job.id, job.kind, {name} AS name, job.state, job.digest FROM job \
         WHERE job.deleted_at IS NULL AND job.id NOT IN "
    ));
    push_jobs(&mut query, reach);
    query
}

fn push_jobs(query: &mut Query, reach: &Reach) {
    query.push_ids(&reach.jobs);
}
