//! What the front page lists: the jobs that somebody asked for, without those that a pipeline
//! made for itself.

use store::Page;
use wire::{JobState, Jobs};

use crate::app::App;
use crate::error::ApiError;

impl App {
    /// Pipelines, and jobs that no pipeline made, newest first.
    pub async fn experiments(
        &self,
        state: Option<JobState>,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Jobs, ApiError> {
        // One more than is shown tells whether there is another page.
        let mut rows = self.store.experiments(state, Page { before, limit: limit + 1 }).await?;
        let has_more = rows.len() > limit as usize;
        rows.truncate(limit as usize);
        let next = rows.last().map(|row| row.id.0).filter(|_| has_more);
        Ok(Jobs { jobs: self.complete(rows).await?, next })
    }
}
