use super::Database;
use super::rows::stored_object;
use super::transfer::select_objects;
use crate::StoredObject;

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
}
