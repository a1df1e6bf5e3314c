use sqlx::QueryBuilder;

use super::rows::stored_object;
use super::{Database, Db};
use crate::StoredObject;

impl Database {
    /// The objects that a table names, by path, from the first after `path`.
    pub async fn objects_named_by(
        &self,
        table: &str,
        path: &str,
        limit: i64,
    ) -> Result<Vec<StoredObject>, sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(format!("SELECT path, size, sha256 FROM {table}"));
        query.push(" WHERE path > ").push_bind(path);
        query.push(" ORDER BY path LIMIT ").push_bind(limit);
        let rows = query.build().fetch_all(&self.reader).await?;
        rows.iter().map(stored_object).collect()
    }
}
