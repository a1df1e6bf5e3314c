//! The list on the front page: jobs that somebody asked for, without those that a pipeline made for
//! itself.

use wire::Jobs;

use crate::app::App;
use crate::app::listing::{EXPERIMENTS, ListRequest};
use crate::error::ApiError;

impl App {
    /// Pipelines, and jobs that do not belong to one; newest first unless the parameters say
    /// otherwise.
    pub async fn experiments(
        &self,
        parameters: &[(String, String)],
        limit: u32,
    ) -> Result<Jobs, ApiError> {
        let mut request = ListRequest::read(&EXPERIMENTS, parameters)?;
        request.listing.limit = limit;
        self.jobs(&request).await
    }
}
