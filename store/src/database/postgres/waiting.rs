//! Waiting for a task by LISTEN and NOTIFY.

use std::time::Duration;

use sqlx::postgres::PgListener;

use super::Database;

/// The channel that is notified when tasks were queued.
pub(super) const CHANNEL: &str = "torqued_queue";

/// A connection that listens.
#[derive(Debug)]
pub(crate) struct Bell(PgListener);

impl Database {
    pub async fn bell(&self) -> Result<Bell, sqlx::Error> {
        let mut listener = PgListener::connect_with(&self.reader).await?;
        listener.listen(CHANNEL).await?;
        Ok(Bell(listener))
    }
}

impl Bell {
    /// Waits until tasks may have been queued, or for `longest`. Returns which of the two happened.
    pub async fn wait(&mut self, longest: Duration) -> Result<bool, sqlx::Error> {
        // A connection that broke may have missed a notification, so this counts as one.
        let Ok(notification) = tokio::time::timeout(longest, self.0.try_recv()).await else {
            return Ok(false);
        };
        notification?;
        // One look at the queue covers all notifications that arrived meanwhile.
        while self.0.next_buffered().is_some() {}
        Ok(true)
    }
}
