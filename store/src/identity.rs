//! Which store objects belong to. A server deletes objects that no row of its database names, so that it must not be
//! led to those of another database.

use bytes::Bytes;
use object_store::{ObjectStoreExt, PutMode, PutOptions};
use serde::{Deserialize, Serialize};

use crate::boxed;
use crate::database::sql;
use crate::objects::path::MARKER;
use crate::{Access, Store, StoreError};

/// The object that says whose the objects beside it are.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Marker {
    store: String,
}

const REMEDY: &str = "give each database a folder or a bucket's prefix of its own";

impl Store {
    /// The name that tells this store from others: 32 hexadecimal digits.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn identity(&self) -> Result<String, StoreError> {
        sql!(self.database(), "reading the store's identity", identity())
    }

    /// # Errors
    /// [`StoreError::ForeignObjects`] when the objects belong to another store.
    pub(crate) async fn check_objects(&self, access: Access) -> Result<(), StoreError> {
        let own = Marker { store: self.identity().await? };
        let found = match self.marker().await? {
            None if access == Access::Server => {
                self.mark(&own).await?;
                self.marker().await?
            }
            found => found,
        };
        if found.is_some_and(|found| found != own) {
            let place = self.objects().place();
            return Err(StoreError::ForeignObjects { place, remedy: REMEDY });
        }
        Ok(())
    }

    async fn marker(&self) -> Result<Option<Marker>, StoreError> {
        let failed = || StoreError::object("reading", MARKER);
        let found = match self.objects().remote().get(&object_store::path::Path::from(MARKER)).await
        {
            Err(object_store::Error::NotFound { .. }) => return Ok(None),
            found => found.map_err(failed())?,
        };
        let bytes = found.bytes().await.map_err(failed())?;
        let unreadable = |error: serde_json::Error| object_store::Error::Generic {
            store: "marker",
            source: error.into(),
        };
        serde_json::from_slice(&bytes).map(Some).map_err(unreadable).map_err(failed())
    }

    /// Two servers may do so at once: one of them is first.
    async fn mark(&self, own: &Marker) -> Result<(), StoreError> {
        let text = Bytes::from(format!("{{\"store\": \"{}\"}}\n", own.store));
        if self.objects().away().is_some() {
            return match self.put_object(MARKER, text).await {
                Ok(_) | Err(StoreError::ObjectTaken { .. }) => Ok(()),
                Err(error) => Err(error),
            };
        }
        let create = PutOptions { mode: PutMode::Create, ..PutOptions::default() };
        let path = object_store::path::Path::from(MARKER);
        match self.objects().remote().put_opts(&path, text.into(), create).await {
            Ok(_) | Err(object_store::Error::AlreadyExists { .. }) => Ok(()),
            Err(error) => Err(StoreError::object("writing", MARKER)(error)),
        }
    }
}
