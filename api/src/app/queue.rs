//! The queue as a whole.

use wire::Queue;

use crate::app::App;
use crate::app::jobs::text;
use crate::error::ApiError;

impl App {
    pub(crate) async fn queue(&self) -> Result<Queue, ApiError> {
        let store::Queue { paused_at, queued, running } = self.store.queue().await?;
        Ok(Queue { paused: paused_at.is_some(), paused_at: text(paused_at), queued, running })
    }

    pub(crate) async fn pause_queue(&self) -> Result<Queue, ApiError> {
        self.store.pause_queue().await?;
        self.queue().await
    }

    pub(crate) async fn resume_queue(&self) -> Result<Queue, ApiError> {
        self.store.resume_queue().await?;
        self.queue().await
    }
}
