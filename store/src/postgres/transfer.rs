//! Statements of a move that PostgreSQL has in its own way.

use sqlx::QueryBuilder;
use sqlx::types::Json;

use super::Transaction;
use crate::transfer::tables::FoundColumn;

impl Transaction {
    /// Nobody else writes to the tables while this transaction lasts, which is as long as it takes.
    pub async fn keep_still(&mut self, tables: &[&str]) -> Result<(), sqlx::Error> {
        let patient = sqlx::query("SET LOCAL idle_in_transaction_session_timeout = 0");
        self.execute(patient).await?;
        let lock = format!("LOCK TABLE {} IN SHARE MODE", tables.join(", "));
        QueryBuilder::new(lock).build().execute(self.connection()).await?;
        Ok(())
    }

    /// The columns of these tables. Others may be in the database, and are none of ours.
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

    /// The largest id that a table has given so far; none of a table that gives no ids.
    pub async fn last_number(&mut self, table: &str) -> Result<Option<i64>, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT pg_sequence_last_value(CAST(pg_get_serial_sequence($1, 'id') AS regclass))",
        )
        .bind(table)
        .fetch_one(self.connection())
        .await
    }

    /// The next id of the table is larger.
    pub async fn set_last_number(&mut self, table: &str, last: i64) -> Result<(), sqlx::Error> {
        // A sequence begins at 1, and nothing is to be done before it was used.
        if last < 1 {
            return Ok(());
        }
        let set =
            sqlx::query("SELECT setval(CAST(pg_get_serial_sequence($1, 'id') AS regclass), $2)");
        self.execute(set.bind(table).bind(last)).await
    }
}
