use futures::TryStreamExt;
use sqlx::{QueryBuilder, Row};
use tokio::sync::mpsc;

use super::rows::stored_object;
use super::{Database, Db, DbRow, Transaction};
use crate::StoredObject;
use crate::transfer::rows::{DatabaseColumn, Kind, Table, Value, Values};

/// Values per statement. SQLite binds 32 766 at most, PostgreSQL 65 535.
const VALUES_PER_STATEMENT: usize = 32_000;

/// Approximate number of bytes of rows that are read or written at once.
const BYTES_PER_BATCH: usize = 4 * 1024 * 1024;

/// Objects that a table names, sorted by path, beginning after `path`.
pub(super) fn select_objects(table: &str, path: &str, limit: i64) -> QueryBuilder<Db> {
    let mut query = QueryBuilder::new(format!("SELECT path, size, sha256 FROM {table}"));
    query.push(" WHERE path > ").push_bind(path.to_owned());
    query.push(" ORDER BY path LIMIT ").push_bind(limit);
    query
}

impl Database {
    /// Whether a row names the object.
    pub async fn names_object(&self, table: &str, path: &str) -> Result<bool, sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(format!("SELECT COUNT(*) FROM {table}"));
        query.push(" WHERE path = ").push_bind(path);
        let count: i64 = query.build_query_scalar().fetch_one(&self.reader).await?;
        Ok(count > 0)
    }
}

impl Transaction {
    /// Deletes the checkpoint with a file at `path`.
    pub async fn forget_checkpoint_with(&mut self, path: &str) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "DELETE FROM checkpoint WHERE id IN (SELECT checkpoint FROM checkpoint_file WHERE path = $1)",
        );
        self.execute(statement.bind(path)).await
    }

    pub async fn count_rows(&mut self, table: &str) -> Result<u64, sqlx::Error> {
        let count: i64 = QueryBuilder::<Db>::new(format!("SELECT COUNT(*) FROM {table}"))
            .build_query_scalar()
            .fetch_one(self.connection())
            .await?;
        Ok(count.unsigned_abs())
    }

    /// The sum of the sizes of a table's objects.
    pub async fn bytes_of_objects(&mut self, table: &str) -> Result<u64, sqlx::Error> {
        let select = format!("SELECT CAST(COALESCE(SUM(size), 0) AS BIGINT) FROM {table}");
        let bytes: i64 = QueryBuilder::<Db>::new(select)
            .build_query_scalar()
            .fetch_one(self.connection())
            .await?;
        Ok(bytes.unsigned_abs())
    }

    /// Objects sorted by path, beginning after `path`.
    pub async fn objects_after(
        &mut self,
        table: &str,
        path: &str,
        limit: i64,
    ) -> Result<Vec<StoredObject>, sqlx::Error> {
        let mut query = select_objects(table, path, limit);
        let rows = query.build().fetch_all(self.connection()).await?;
        rows.iter().map(stored_object).collect()
    }

    /// Some tasks with a valid lease, each with its job and its worker.
    pub async fn leased_tasks(&mut self, limit: i64) -> Result<Vec<String>, sqlx::Error> {
        let rows = sqlx::query(concat!(
            "SELECT id, job, label, worker, lease_until - ",
            now!(),
            " AS lasts FROM task WHERE state = 'running' AND lease_until > ",
            now!(),
            " ORDER BY id LIMIT $1"
        ))
        .bind(limit)
        .fetch_all(self.connection())
        .await?;
        let name = |row: &DbRow| {
            let (id, job): (i64, i64) = (row.try_get("id")?, row.try_get("job")?);
            let label: &str = row.try_get("label")?;
            let worker: Option<&str> = row.try_get("worker")?;
            let worker = worker.unwrap_or("without a name");
            let milliseconds: i64 = row.try_get("lasts")?;
            let seconds = milliseconds.unsigned_abs().div_ceil(1000);
            Ok(format!(
                "worker {worker}, which has task {id} ({label}) of job {job} for {seconds} s more"
            ))
        };
        rows.iter().map(name).collect()
    }

    /// Sends all rows of a table in batches, until the receiver is gone.
    pub async fn send_rows(
        &mut self,
        table: &Table,
        to: mpsc::Sender<Vec<Values>>,
    ) -> Result<(), sqlx::Error> {
        let select = format!("SELECT {} FROM {}", table.column_list(), table.name);
        let mut query = QueryBuilder::<Db>::new(select);
        let mut rows = query.build().fetch(self.connection());
        let rows_per_batch = VALUES_PER_STATEMENT / table.columns.len().max(1);
        let (mut batch, mut bytes) = (Vec::new(), 0);
        while let Some(row) = rows.try_next().await? {
            let values = values(&row, &table.columns)?;
            bytes += values.iter().map(Value::size).sum::<usize>();
            batch.push(values);
            if batch.len() >= rows_per_batch || bytes >= BYTES_PER_BATCH {
                bytes = 0;
                if to.send(std::mem::take(&mut batch)).await.is_err() {
                    return Ok(());
                }
            }
        }
        if !batch.is_empty() {
            // If the receiver is gone, it reports its own error.
            let _ = to.send(batch).await;
        }
        Ok(())
    }

    /// Inserts a batch from [`Transaction::send_rows`].
    pub async fn insert_rows(&mut self, table: &Table, rows: &[Values]) -> Result<(), sqlx::Error> {
        let insert = format!("INSERT INTO {} ({}) ", table.name, table.column_list());
        let mut query = QueryBuilder::<Db>::new(insert);
        query.push_values(rows, |mut row, values| {
            for (column, value) in table.columns.iter().zip(values) {
                match column.kind {
                    Kind::Integer => row.push_bind(value.integer()),
                    Kind::Truth => row.push_bind(value.truth()),
                    Kind::Real => row.push_bind(value.real()),
                    Kind::Text => row.push_bind(value.text()),
                };
            }
        });
        query.build().persistent(false).execute(self.connection()).await?;
        Ok(())
    }

    pub async fn delete_rows(&mut self, table: &str) -> Result<(), sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(format!("DELETE FROM {table}"));
        query.build().execute(self.connection()).await?;
        Ok(())
    }
}

fn values(row: &DbRow, columns: &[DatabaseColumn]) -> Result<Values, sqlx::Error> {
    let value = |(index, column): (usize, &DatabaseColumn)| {
        let value = match column.kind {
            Kind::Integer => row.try_get::<Option<i64>, _>(index)?.map(Value::Integer),
            Kind::Truth => {
                row.try_get::<Option<bool>, _>(index)?.map(i64::from).map(Value::Integer)
            }
            Kind::Real => row.try_get::<Option<f64>, _>(index)?.map(Value::of_real),
            Kind::Text => row.try_get::<Option<String>, _>(index)?.map(Value::Text),
        };
        Ok(value.unwrap_or(Value::Nothing))
    };
    columns.iter().enumerate().map(value).collect()
}
