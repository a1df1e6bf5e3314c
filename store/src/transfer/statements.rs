//! Rows of any table, read and written in batches.

use crate::StoreError;
use crate::database::query::{Query, Row, sql};
use crate::database::{Reading, Transaction};
use futures::TryStreamExt;
use tokio::sync::mpsc;

use crate::StoredObject;
use crate::transfer::rows::{DatabaseColumn, Kind, Table, Value, Values};

/// Values per statement. SQLite binds 32 766 at most, PostgreSQL 65 535.
const VALUES_PER_STATEMENT: usize = 32_000;

/// Approximate number of bytes of rows that are read or written at once.
const BYTES_PER_BATCH: usize = 4 * 1024 * 1024;

/// Objects that a table names, sorted by path, beginning after `path`.
pub(crate) fn select_objects(table: &str, path: &str, limit: i64) -> Query {
    let mut query = sql(format!("SELECT path, size, sha256 FROM {table}"));
    query.push(" WHERE path > ").push_bind(path.to_owned());
    query.push(" ORDER BY path LIMIT ").push_bind(limit);
    query
}

impl Reading<'_> {
    /// Whether a row names the object.
    pub async fn names_object(&mut self, table: &str, path: &str) -> Result<bool, StoreError> {
        let mut query = sql(format!("SELECT COUNT(*) FROM {table}"));
        query.push(" WHERE path = ").push_bind(path);
        let count: i64 = query.one(self).await?;
        Ok(count > 0)
    }
}

impl Transaction {
    /// Deletes the checkpoint with a file at `path`.
    pub async fn forget_checkpoint_with(&mut self, path: &str) -> Result<(), StoreError> {
        sql(
            "DELETE FROM checkpoint WHERE id IN (SELECT checkpoint FROM checkpoint_file WHERE path = $1)",
        ).bind(path).run(self).await
    }

    pub async fn count_rows(&mut self, table: &str) -> Result<u64, StoreError> {
        let count: i64 = sql(format!("SELECT COUNT(*) FROM {table}")).one(self).await?;
        Ok(count.unsigned_abs())
    }

    /// The sum of the sizes of a table's objects.
    pub async fn bytes_of_objects(&mut self, table: &str) -> Result<u64, StoreError> {
        let select = format!("SELECT CAST(COALESCE(SUM(size), 0) AS BIGINT) FROM {table}");
        let bytes: i64 = sql(select).one(self).await?;
        Ok(bytes.unsigned_abs())
    }

    /// Objects sorted by path, beginning after `path`.
    pub async fn objects_after(
        &mut self,
        table: &str,
        path: &str,
        limit: i64,
    ) -> Result<Vec<StoredObject>, StoreError> {
        select_objects(table, path, limit).all(self).await
    }

    /// Some tasks with a valid lease, each with its job and its worker.
    pub async fn leased_tasks(&mut self, limit: i64) -> Result<Vec<String>, StoreError> {
        let rows = sql("SELECT id, job, label, worker, lease_until - {now} AS lasts FROM task \
             WHERE state = 'running' AND lease_until > {now} ORDER BY id LIMIT $1")
        .bind(limit)
        .rows(self)
        .await?;
        let name = |row: &Row| {
            let (id, job): (i64, i64) = (row.get("id")?, row.get("job")?);
            let label: String = row.get("label")?;
            let worker: Option<String> = row.get("worker")?;
            let worker = worker.unwrap_or_else(|| "without a name".to_owned());
            let milliseconds: i64 = row.get("lasts")?;
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
    ) -> Result<(), StoreError> {
        let select = format!("SELECT {} FROM {}", table.column_list(), table.name);
        let query = sql(select);
        let mut rows = self.stream(query);
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
    pub async fn insert_rows(&mut self, table: &Table, rows: &[Values]) -> Result<(), StoreError> {
        let insert = format!("INSERT INTO {} ({}) ", table.name, table.column_list());
        let mut query = sql(insert);
        query.push_values(rows, |row, values| {
            for (column, value) in table.columns.iter().zip(values) {
                match column.kind {
                    Kind::Integer => row.push_bind(value.integer()),
                    Kind::Truth => row.push_bind(value.truth()),
                    Kind::Real => row.push_bind(value.real()),
                    Kind::Text => row.push_bind(value.text()),
                };
            }
        });
        query.persistent(false).changed(self).await?;
        Ok(())
    }

    pub async fn delete_rows(&mut self, table: &str) -> Result<(), StoreError> {
        sql(format!("DELETE FROM {table}")).run(self).await
    }
}

fn values(row: &Row, columns: &[DatabaseColumn]) -> Result<Values, StoreError> {
    let value = |(index, column): (usize, &DatabaseColumn)| {
        let value = match column.kind {
            Kind::Integer => row.get::<Option<i64>>(index)?.map(Value::Integer),
            Kind::Truth => row.get::<Option<bool>>(index)?.map(i64::from).map(Value::Integer),
            Kind::Real => row.get::<Option<f64>>(index)?.map(Value::of_real),
            Kind::Text => row.get::<Option<String>>(index)?.map(Value::Text),
        };
        Ok(value.unwrap_or(Value::Nothing))
    };
    columns.iter().enumerate().map(value).collect()
}
