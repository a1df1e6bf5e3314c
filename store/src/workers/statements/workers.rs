use std::time::Duration;

use sqlx::{FromRow, Row};

use super::rows::{number, resources, text_of_tags};
use super::{Database, DbRow, Transaction, milliseconds};
use crate::{Timestamp, Worker, WorkerProcess, WorkersTask};

impl Database {
    /// Workers sorted by name, each with the newest task that it has.
    pub async fn workers(&self, seen_within: Duration) -> Result<Vec<Worker>, sqlx::Error> {
        sqlx::query_as(concat!(
            "SELECT worker.*, seen_at > ",
            now!(),
            " - $1 AS is_alive, task.id AS task, task.job, task.label FROM worker \
              LEFT JOIN task ON task.id = (SELECT MAX(id) FROM task \
              WHERE task.state = 'running' AND task.worker = worker.name) ORDER BY worker.name"
        ))
        .bind(milliseconds(seen_within))
        .fetch_all(&self.reader)
        .await
    }

    pub async fn now(&self) -> Result<Timestamp, sqlx::Error> {
        sqlx::query_scalar(concat!("SELECT ", now!())).fetch_one(&self.reader).await
    }

    pub async fn ping(&self) -> Result<(), sqlx::Error> {
        sqlx::query("SELECT 1").execute(&self.reader).await.map(|_| ())
    }

    pub async fn identity(&self) -> Result<String, sqlx::Error> {
        let mut connection = self.lend().await?;
        let statement = sqlx::query_scalar("SELECT id FROM store");
        let identity = statement.fetch_one(&mut *connection).await?;
        self.take_back(connection);
        Ok(identity)
    }

    pub async fn server_version(&self) -> Result<Option<String>, sqlx::Error> {
        sqlx::query_scalar("SELECT version FROM server").fetch_optional(&self.reader).await
    }
}

impl Transaction {
    pub async fn set_identity(&mut self, identity: &str) -> Result<(), sqlx::Error> {
        self.execute(sqlx::query("UPDATE store SET id = $1").bind(identity)).await
    }

    pub async fn insert_worker(&mut self, new: &WorkerProcess) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "INSERT INTO worker (name, host, pid, version, device, threads, cpus, gpus, memory_mb, \
              tags, started_at, seen_at) VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, ",
            now!(),
            ", ",
            now!(),
            ") ON CONFLICT (name) DO UPDATE SET host = excluded.host, pid = excluded.pid, \
              version = excluded.version, device = excluded.device, threads = excluded.threads, \
              cpus = excluded.cpus, gpus = excluded.gpus, memory_mb = excluded.memory_mb, \
              tags = excluded.tags, \
              waits_for = NULL, started_at = excluded.started_at, seen_at = excluded.seen_at"
        ))
        .bind(&new.name)
        .bind(&new.host)
        .bind(i64::from(new.pid))
        .bind(&new.version)
        .bind(&new.device)
        .bind(i64::from(new.threads))
        .bind(i64::from(new.offers.cpus.unwrap_or(0)))
        .bind(i64::from(new.offers.gpus))
        .bind(i64::from(new.offers.megabytes()))
        .bind(text_of_tags(&new.offers.tags));
        self.execute(statement).await
    }

    /// Does nothing for a worker whose name another one has taken.
    pub async fn see_worker(
        &mut self,
        worker: &WorkerProcess,
        waits_for: Option<&str>,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "UPDATE worker SET waits_for = $1, seen_at = ",
            now!(),
            " WHERE name = $2 AND host = $3 AND pid = $4"
        ))
        .bind(waits_for)
        .bind(&worker.name)
        .bind(&worker.host)
        .bind(i64::from(worker.pid));
        self.execute(statement).await
    }

    /// Returns whether the worker exists. If it is drained already, the time of the drain stays.
    pub async fn drain_worker(&mut self, name: &str) -> Result<bool, sqlx::Error> {
        let drained = sqlx::query(concat!(
            "UPDATE worker SET drained_at = COALESCE(drained_at, ",
            now!(),
            ") WHERE name = $1"
        ))
        .bind(name)
        .execute(self.connection())
        .await?;
        Ok(drained.rows_affected() > 0)
    }

    /// Returns whether the worker exists.
    pub async fn undrain_worker(&mut self, name: &str) -> Result<bool, sqlx::Error> {
        let undrained = sqlx::query("UPDATE worker SET drained_at = NULL WHERE name = $1")
            .bind(name)
            .execute(self.connection())
            .await?;
        Ok(undrained.rows_affected() > 0)
    }

    pub async fn delete_worker(&mut self, worker: &WorkerProcess) -> Result<(), sqlx::Error> {
        let statement =
            sqlx::query("DELETE FROM worker WHERE name = $1 AND host = $2 AND pid = $3")
                .bind(&worker.name)
                .bind(&worker.host)
                .bind(i64::from(worker.pid));
        self.execute(statement).await
    }

    pub async fn forget_dead_workers(&mut self, after: Duration) -> Result<(), sqlx::Error> {
        let statement =
            sqlx::query(concat!("DELETE FROM worker WHERE seen_at < ", now!(), " - $1"))
                .bind(milliseconds(after));
        self.execute(statement).await
    }

    pub async fn set_server(&mut self, version: &str) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "INSERT INTO server (id, version, started_at) VALUES (1, $1, ",
            now!(),
            ") ON CONFLICT (id) DO UPDATE SET version = excluded.version, \
              started_at = excluded.started_at"
        ))
        .bind(version);
        self.execute(statement).await
    }

    /// Writes a row, to test that the database can be written to.
    pub async fn probe(&mut self) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "INSERT INTO probe (id, written_at) VALUES (1, ",
            now!(),
            ") ON CONFLICT (id) DO UPDATE SET written_at = excluded.written_at"
        ));
        self.execute(statement).await
    }
}

impl FromRow<'_, DbRow> for Worker {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        let task: Option<_> = row.try_get("task")?;
        let task = task.map(|id| {
            Ok::<_, sqlx::Error>(WorkersTask {
                id,
                job: row.try_get("job")?,
                label: row.try_get("label")?,
            })
        });
        Ok(Self {
            process: WorkerProcess {
                name: row.try_get("name")?,
                host: row.try_get("host")?,
                pid: number(row, "pid")?,
                version: row.try_get("version")?,
                device: row.try_get("device")?,
                threads: number(row, "threads")?,
                offers: resources(row)?,
            },
            drained_at: row.try_get("drained_at")?,
            waits_for: row.try_get("waits_for")?,
            started_at: row.try_get("started_at")?,
            seen_at: row.try_get("seen_at")?,
            is_alive: row.try_get("is_alive")?,
            task: task.transpose()?,
        })
    }
}
