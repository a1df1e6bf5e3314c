//! Which events have settled: in SQLite all that can be read, since one transaction writes at a time.

use super::Database;

#[derive(Debug, Default)]
pub(crate) struct Horizon;

impl Database {
    /// The id up to which no event will appear any more that cannot be read now.
    pub async fn settled_event(&self, _: &mut Horizon) -> Result<Option<i64>, sqlx::Error> {
        sqlx::query_scalar("SELECT MAX(id) FROM event").fetch_one(&self.reader).await
    }
}
