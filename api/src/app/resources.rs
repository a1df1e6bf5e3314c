//! The operations that all resources have: a page of their list, and one of them by its id.

use serde::Serialize;
use serde_json::Value;
use store::{Listing, Store, StoreError};
use wire::{ListPage as _, Listed};

use crate::app::App;
use crate::app::files::Download;
use crate::app::listing::ListRequest;
use crate::error::ApiError;

/// A resource of the API.
pub trait Resource: Listed<Page: Serialize> + Serialize + Send {
    /// The resource as the store has it.
    type Row: Send;

    /// A page of rows.
    fn rows(
        store: &Store,
        listing: &Listing,
    ) -> impl Future<Output = Result<store::Listed<Self::Row>, StoreError>> + Send;

    /// The spec in the answer about this row, which may be large.
    fn spec(row: &Self::Row) -> Option<&Value>;

    /// Adds data from other tables, as far as lists show it. The number of statements does not
    /// depend on the number of rows.
    fn complete(
        app: &App,
        rows: Vec<Self::Row>,
    ) -> impl Future<Output = Result<Vec<Self>, ApiError>> + Send;

    /// One of them, with everything that is known about it.
    fn find(app: &App, id: i64) -> impl Future<Output = Result<Self, ApiError>> + Send;
}

/// A resource with files.
pub trait Downloaded: Resource {
    fn file(
        app: &App,
        id: i64,
        name: &str,
    ) -> impl Future<Output = Result<Download, ApiError>> + Send;

    /// All its files so far, as a tar.
    fn tar(app: &App, id: i64) -> impl Future<Output = Result<Download, ApiError>> + Send;
}

impl App {
    /// A page of the list of `T`.
    pub(crate) async fn list<T: Resource>(
        &self,
        request: &ListRequest,
    ) -> Result<T::Page, ApiError> {
        let mut listed = T::rows(&self.store, &request.listing).await?;
        if let Some(shorter) = request.shorter(listed.items.iter().filter_map(T::spec)) {
            listed = T::rows(&self.store, &shorter).await?;
        }
        let items = T::complete(self, listed.items).await?;
        Ok(T::Page::new(items, request.next(listed.end)))
    }
}
