//! The list on the front page: jobs that somebody asked for, without those that a pipeline made for
//! itself.

use wire::{Job, Jobs, List, Listed};

use crate::app::App;
use crate::app::listing::ListRequest;
use crate::error::ApiError;

static EXPERIMENTS: List = List { name: "experiments", ..Job::LIST };

impl App {
    /// Pipelines, and jobs that do not belong to one; newest first unless the parameters say
    /// otherwise.
    pub(crate) async fn experiments(
        &self,
        parameters: &[(String, String)],
        limit: u32,
    ) -> Result<Jobs, ApiError> {
        let mut request = ListRequest::read(&EXPERIMENTS, parameters)?;
        request.listing.experiments_alone = true;
        request.listing.limit = limit;
        self.list::<Job>(&request).await
    }
}
