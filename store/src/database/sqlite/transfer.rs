//! Statements of a transfer in SQLite's dialect.

use super::Transaction;
use crate::transfer::tables::FoundColumn;

impl Transaction {
    /// Does nothing, because nobody else writes while this transaction lasts.
    #[expect(clippy::unused_async, reason = "other databases lock here")]
    pub async fn keep_still(&mut self, _: &[&str]) -> Result<(), sqlx::Error> {
        Ok(())
    }

    /// The columns of all tables. The database of a data folder has no others.
    pub async fn columns(&mut self, _: &[&str]) -> Result<Vec<FoundColumn>, sqlx::Error> {
        let rows: Vec<(String, String, String)> = sqlx::query_as(
            "SELECT found.name, \"column\".name, \"column\".type FROM sqlite_schema AS found \
             JOIN pragma_table_info(found.name) AS \"column\" \
             WHERE found.type = 'table' AND found.name NOT LIKE 'sqlite%' AND found.name <> '_sqlx_migrations'",
        )
        .fetch_all(self.connection())
        .await?;
        let column = |(table, name, type_name)| FoundColumn { table, name, type_name };
        Ok(rows.into_iter().map(column).collect())
    }

    /// The largest id that a table has assigned so far; `None` for a table without assigned ids.
    pub async fn last_number(&mut self, table: &str) -> Result<Option<i64>, sqlx::Error> {
        sqlx::query_scalar("SELECT seq FROM sqlite_sequence WHERE name = $1")
            .bind(table)
            .fetch_optional(self.connection())
            .await
    }

    /// Makes the next id of the table larger than `last`.
    pub async fn set_last_number(&mut self, table: &str, last: i64) -> Result<(), sqlx::Error> {
        let forget = sqlx::query("DELETE FROM sqlite_sequence WHERE name = $1").bind(table);
        self.execute(forget).await?;
        let set = sqlx::query("INSERT INTO sqlite_sequence (name, seq) VALUES ($1, $2)");
        self.execute(set.bind(table).bind(last)).await
    }
}
