use spec::{Moment, Resources};
use sqlx::types::Json;
use sqlx::{AssertSqlSafe, FromRow, Row};

use super::line::may_be_claimed;
use super::rows::{moment, number, resources, text_of_tags};
use super::{Database, DbRow, Transaction};
use crate::identifiers::ResourcesId;
use crate::{Demand, JobId};

impl Database {
    /// The tasks that may be claimed, grouped by the resources they ask for, in the order of the
    /// queue.
    pub async fn demand(&self) -> Result<Vec<Demand>, sqlx::Error> {
        sqlx::query_as(AssertSqlSafe(demand())).fetch_all(&self.reader).await
    }

    /// Jobs with queued tasks that ask for resources or may not begin yet, with these resources and
    /// the start time.
    pub async fn asked_by(
        &self,
        jobs: &[JobId],
    ) -> Result<Vec<(JobId, Resources, Option<Moment>)>, sqlx::Error> {
        let rows = sqlx::query(concat!(
            "SELECT job.id AS job, asked.cpus, asked.gpus, asked.memory_mb, asked.tags, \
              CASE WHEN job.not_before > ",
            now!(),
            concat!(
                " THEN job.not_before ELSE 0 END AS begins_at \
              FROM job JOIN resources AS asked ON asked.id = job.resources \
              WHERE job.id IN ",
                listed_ids!("$1"),
                " AND job.state IN ('queued', 'running') \
              AND (asked.cpus > 0 OR asked.gpus > 0 OR asked.memory_mb > 0 OR asked.tags <> '[]' \
                   OR job.not_before > "
            ),
            now!(),
            ") AND EXISTS (SELECT 1 FROM task WHERE task.job = job.id AND task.state = 'queued')"
        ))
        .bind(Json(jobs))
        .fetch_all(&self.reader)
        .await?;
        let read =
            |row: &DbRow| Ok((row.try_get("job")?, resources(row)?, moment(row, "begins_at")?));
        rows.iter().map(read).collect()
    }
}

impl Transaction {
    /// The id of a combination of resources. Inserts it if it is new.
    pub async fn resources_id(&mut self, asked: &Resources) -> Result<ResourcesId, sqlx::Error> {
        if let Some(id) = self.find_resources(asked).await? {
            return Ok(id);
        }
        let statement = sqlx::query(
            "INSERT INTO resources (cpus, gpus, memory_mb, tags) VALUES ($1, $2, $3, $4) \
             ON CONFLICT (cpus, gpus, memory_mb, tags) DO NOTHING",
        )
        .bind(i64::from(asked.cpus.unwrap_or(0)))
        .bind(i64::from(asked.gpus))
        .bind(i64::from(asked.megabytes()))
        .bind(text_of_tags(&asked.tags));
        self.execute(statement).await?;
        self.find_resources(asked).await?.ok_or(sqlx::Error::RowNotFound)
    }

    async fn find_resources(
        &mut self,
        asked: &Resources,
    ) -> Result<Option<ResourcesId>, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT id FROM resources WHERE cpus = $1 AND gpus = $2 AND memory_mb = $3 AND tags = $4",
        )
        .bind(i64::from(asked.cpus.unwrap_or(0)))
        .bind(i64::from(asked.gpus))
        .bind(i64::from(asked.megabytes()))
        .bind(text_of_tags(&asked.tags))
        .fetch_optional(self.connection())
        .await
    }
}

fn demand() -> String {
    format!(
        "SELECT asked.cpus, asked.gpus, asked.memory_mb, asked.tags, found.waiting \
         FROM (SELECT resources, COUNT(*) AS waiting, MIN(turn) AS turn FROM task WHERE {} \
               GROUP BY resources) AS found \
         JOIN resources AS asked ON asked.id = found.resources ORDER BY found.turn, asked.id",
        may_be_claimed()
    )
}

impl FromRow<'_, DbRow> for Demand {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self { resources: resources(row)?, waiting: number(row, "waiting")? })
    }
}
