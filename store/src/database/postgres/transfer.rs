//! Statements of a transfer in PostgreSQL's dialect.

use sqlx::QueryBuilder;
use sqlx::types::Json;

use super::Transaction;
use crate::transfer::tables::FoundColumn;

impl Transaction {
    /// Locks the tables against all other writers until this transaction ends.
    pub async fn keep_still(&mut self, tables: &[&str]) -> Result<(), sqlx::Error> {
        let patient = sqlx::query("SET LOCAL idle_in_transaction_session_timeout = 0");
        self.execute(patient).await?;
        let lock = format!("LOCK TABLE {} IN SHARE MODE", tables.join(", "));
        QueryBuilder::new(lock).build().execute(self.connection()).await?;
        Ok(())
    }

    /// The columns of these tables. The database may have other tables, which are not ours.
    pub async fn columns(&mut self, tables: &[&str]) -> Result<Vec<FoundColumn>, sqlx::Error> {
        let rows: Vec<(String, String, String)> = sqlx::query_as(concat!(
            "SELECT CAST(table_name AS TEXT), CAST(column_name AS TEXT), CAST(data_type AS TEXT) \
             FROM information_schema.columns WHERE table_schema = current_schema() \
             AND table_name IN ",
            listed_texts!("$1")
        ))
        .bind(Json(tables))
        .fetch_all(self.connection())
        .await?;
        let column = |(table, name, type_name)| FoundColumn { table, name, type_name };
        Ok(rows.into_iter().map(column).collect())
    }

    /// The largest id that a table has assigned so far; `None` for a table without assigned ids.
    pub async fn last_number(&mut self, table: &str) -> Result<Option<i64>, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT pg_sequence_last_value(CAST(pg_get_serial_sequence($1, 'id') AS regclass))",
        )
        .bind(table)
        .fetch_one(self.connection())
        .await
    }

    /// Makes the next id of the table larger than `last`.
    pub async fn set_last_number(&mut self, table: &str, last: i64) -> Result<(), sqlx::Error> {
        // A sequence begins at 1. Before its first use there is nothing to do.
        if last < 1 {
            return Ok(());
        }
        let set =
            sqlx::query("SELECT setval(CAST(pg_get_serial_sequence($1, 'id') AS regclass), $2)");
        self.execute(set.bind(table).bind(last)).await
    }
}
