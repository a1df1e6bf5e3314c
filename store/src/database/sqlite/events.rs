//! Settled events. In SQLite every event that can be read has settled, because only one transaction
//! writes at a time.

use super::Database;

#[derive(Debug, Default)]
pub(crate) struct Horizon;

impl Database {
    /// The id up to which all events can be read, so none will appear later.
    pub async fn settled_event(&self, _: &mut Horizon) -> Result<Option<i64>, sqlx::Error> {
        sqlx::query_scalar("SELECT MAX(id) FROM event").fetch_one(&self.reader).await
    }
}
