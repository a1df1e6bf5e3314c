//! The parameters of every list.

use serde::Deserialize;
use utoipa::IntoParams;

use crate::app::Paging;
use crate::error::ApiError;

/// Which part of a list is asked for.
#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct ListParameters {
    /// Items at most, 1 to 500; 50 when left out.
    pub limit: Option<u32>,
    /// Only items with a smaller id.
    pub before: Option<i64>,
}

impl ListParameters {
    pub fn paging(&self) -> Result<Paging, ApiError> {
        Paging::new(self.limit, self.before)
    }
}
