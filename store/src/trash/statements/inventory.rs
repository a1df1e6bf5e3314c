use sqlx::QueryBuilder;

use super::rows::stored_object;
use super::transfer::select_objects;
use super::{Database, Db};
use crate::StoredObject;
use crate::transfer::tables::in_words;

impl Database {
    /// The objects that a table names, sorted by path, beginning after `path`.
    pub async fn objects_named_by(
        &self,
        table: &str,
        path: &str,
        limit: i64,
    ) -> Result<Vec<StoredObject>, sqlx::Error> {
        let mut query = select_objects(table, path, limit);
        let rows = query.build().fetch_all(&self.reader).await?;
        rows.iter().map(stored_object).collect()
    }

    /// The number of rows of the first of these tables that has any, in words.
    pub async fn first_content(&self, tables: &[&str]) -> Result<Option<String>, sqlx::Error> {
        for table in tables {
            let count: i64 = QueryBuilder::<Db>::new(format!("SELECT COUNT(*) FROM {table}"))
                .build_query_scalar()
                .fetch_one(&self.reader)
                .await?;
            if count > 0 {
                return Ok(Some(in_words(table, count.unsigned_abs())));
            }
        }
        Ok(None)
    }
}
