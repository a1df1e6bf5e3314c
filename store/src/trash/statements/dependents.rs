use sqlx::types::Json;
use sqlx::{QueryBuilder, Row};
use wire::Relation;

use super::rows::{digest, state};
use super::{Db, DbRow, LISTED_IDS, LISTED_TEXTS, Transaction};
use crate::Dependent;
use crate::trash::Reach;

const SELECT: &str = "SELECT job.id, job.kind, job.name, job.state, job.digest FROM job \
     WHERE job.deleted_at IS NULL AND job.id NOT IN ";

/// The condition that a job has not ended, or has left something that still exists.
const COUNTS: &str = " AND (job.state NOT IN ('succeeded', 'failed', 'cancelled') \
     OR EXISTS (SELECT 1 FROM dataset WHERE dataset.job = job.id AND dataset.deleted_at IS NULL) \
     OR EXISTS (SELECT 1 FROM run WHERE run.job = job.id AND run.deleted_at IS NULL))";

impl Transaction {
    /// Jobs whose specs name the digests, and jobs that need the jobs.
    pub async fn readers(&mut self, reach: &Reach) -> Result<Vec<Dependent>, sqlx::Error> {
        let mut query = others(reach);
        query.push(COUNTS).push(" AND job.id IN (SELECT job FROM job_input WHERE digest IN ");
        query.push(LISTED_TEXTS.0).push_bind(Json(reach.digests.clone())).push(LISTED_TEXTS.1);
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
    pub async fn successors(&mut self, reach: &Reach) -> Result<Vec<Dependent>, sqlx::Error> {
        let mut query = others(reach);
        query.push(" AND job.digest IN ").push(LISTED_TEXTS.0);
        query.push_bind(Json(reach.digests.clone())).push(LISTED_TEXTS.1);
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
    pub async fn holders(&mut self, reach: &Reach) -> Result<Vec<Dependent>, sqlx::Error> {
        let mut query = others(reach);
        query.push(" AND job.id IN (SELECT pipeline FROM pipeline_member WHERE job IN ");
        push_jobs(&mut query, reach);
        query.push(")");
        self.jobs_that(Relation::Holds, query).await
    }

    async fn jobs_that(
        &mut self,
        relation: Relation,
        mut query: QueryBuilder<Db>,
    ) -> Result<Vec<Dependent>, sqlx::Error> {
        let rows = query.build().fetch_all(self.connection()).await?;
        let dependent = |row: &DbRow| {
            Ok(Dependent {
                job: row.try_get("id")?,
                kind: row.try_get("kind")?,
                name: row.try_get("name")?,
                state: state(row)?,
                relation,
                digest: digest(row, "digest")?,
            })
        };
        rows.iter().map(dependent).collect()
    }
}

fn others(reach: &Reach) -> QueryBuilder<Db> {
    let mut query = QueryBuilder::<Db>::new(SELECT);
    push_jobs(&mut query, reach);
    query
}

fn push_jobs(query: &mut QueryBuilder<Db>, reach: &Reach) {
    query.push(LISTED_IDS.0).push_bind(Json(reach.jobs.clone())).push(LISTED_IDS.1);
}
