//! The identity of a store, which its objects carry. A server deletes objects that have no row in
//! its database, so it must never run on objects of another database. While a store moves to a new
//! place, a second mark says that its objects are not all there yet.

use bytes::Bytes;
use object_store::path::Path;
use object_store::{ObjectStoreExt, PutMode, PutOptions};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::boxed;
use crate::database::Scope;
use crate::objects::mark::Marker;
use crate::objects::path::{MARKER, MOVE_MARKER};
use crate::place::new_place;
use crate::{Access, Location, Store, StoreError};

/// The object that says that another store is moving here. It exists from before the first object
/// is copied until the rows are committed.
#[derive(Debug, Serialize, Deserialize)]
struct MoveMarker {
    /// The identity of the store that moves.
    from: String,
}

const REMEDY: &str = "give each database a folder or a bucket's prefix of its own";

impl Store {
    /// The store's unique name: 32 hexadecimal digits.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn identity(&self) -> Result<String, StoreError> {
        self.read("reading the store's identity").identity().await
    }

    /// Checks that the objects are those of this store. The objects of a new store get its mark.
    ///
    /// # Errors
    /// [`StoreError::ForeignObjects`] when the objects belong to another store.
    /// [`StoreError::FilesLost`] when the place has no mark although the store is not new.
    /// [`StoreError::UnfinishedTransfer`] when a store was moving here and its objects may not all
    /// be there. An error of [`Store::check_unmarked`] when the place is not that of a new store.
    pub(crate) async fn check_objects(
        &self,
        location: &Location,
        access: Access,
    ) -> Result<(), StoreError> {
        let own = Marker { store: self.identity().await? };
        let found = self.read_mark(MARKER).await?;
        if access == Access::Rebuilding {
            return self.adopt_objects(found).await;
        }
        let found: Option<Marker> = match found {
            None if access.is_owner() => {
                self.check_unmarked(location, access).await?;
                self.write_mark(MARKER, &own).await?;
                self.read_mark(MARKER).await?
            }
            None => {
                return Err(new_place::no_files(self.objects().place(), "has no store.json"));
            }
            found => found,
        };
        let place = || self.objects().place();
        if found.is_some_and(|found| found != own) {
            return Err(StoreError::ForeignObjects { place: place(), remedy: REMEDY });
        }
        if access != Access::Transfer && self.moving_from().await?.is_some() {
            return Err(StoreError::UnfinishedTransfer { place: place() });
        }
        self.objects().expect_mark(own);
        Ok(())
    }

    /// Checks that the place of the objects is still that of this store.
    ///
    /// # Errors
    /// [`StoreError::Displaced`] when it has no mark or that of another store.
    pub(crate) async fn check_place_now(&self) -> Result<(), StoreError> {
        self.objects().check_place_now().await
    }

    /// Gives the objects of a store whose database is lost to this store. Objects without a mark
    /// get one from [`Store::mark_place`], once something was found among them.
    async fn adopt_objects(&self, found: Option<Marker>) -> Result<(), StoreError> {
        let Some(found) = found else { return Ok(()) };
        if found.store != self.identity().await? {
            let mut tx = self.begin(Scope::Rows, "taking objects over").await?;
            tx.set_identity(&found.store).await?;
            tx.commit().await?;
        }
        self.objects().expect_mark(found);
        Ok(())
    }

    /// Marks the place of the objects as this store's, if it has no mark.
    ///
    /// # Errors
    /// When the mark cannot be written.
    #[boxed]
    pub async fn mark_place(&self) -> Result<(), StoreError> {
        let own = Marker { store: self.identity().await? };
        self.write_mark(MARKER, &own).await?;
        self.objects().expect_mark(own);
        Ok(())
    }

    /// The identity of the store that is moving here, if there is one.
    pub(crate) async fn moving_from(&self) -> Result<Option<String>, StoreError> {
        let found: Option<MoveMarker> = self.read_mark(MOVE_MARKER).await?;
        Ok(found.map(|found| found.from))
    }

    /// Begins a move. No server and no worker opens this store until the move has ended.
    pub(crate) async fn begin_move(&self, from: String) -> Result<(), StoreError> {
        self.write_mark(MOVE_MARKER, &MoveMarker { from }).await
    }

    pub(crate) async fn end_move(&self) -> Result<(), StoreError> {
        let deleted = self.objects().remote().delete(&Path::from(MOVE_MARKER)).await;
        deleted.map_err(StoreError::object("deleting", MOVE_MARKER))
    }

    async fn read_mark<M: DeserializeOwned>(&self, path: &str) -> Result<Option<M>, StoreError> {
        let failed = || StoreError::object("reading", path);
        let found = match self.objects().remote().get(&Path::from(path)).await {
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

    /// Writes a mark. If two servers write it at once, one of them is first.
    async fn write_mark(&self, path: &str, mark: &impl Serialize) -> Result<(), StoreError> {
        let text = Bytes::from(format!("{}\n", serde_json::json!(mark)));
        if self.objects().away().is_some() {
            return match self.put_object(path, text).await {
                Ok(_) | Err(StoreError::ObjectTaken { .. }) => Ok(()),
                Err(error) => Err(error),
            };
        }
        let create = PutOptions { mode: PutMode::Create, ..PutOptions::default() };
        match self.objects().remote().put_opts(&Path::from(path), text.into(), create).await {
            Ok(_) | Err(object_store::Error::AlreadyExists { .. }) => Ok(()),
            Err(error) => Err(StoreError::object("writing", path)(error)),
        }
    }
}
