//! The laws of the store, held to every database and every place for objects that it supports.

#![expect(clippy::unwrap_used, reason = "tests")]

mod postgres;
mod suite;

/// SQLite, with objects in the data folder.
mod sqlite {
    use store::{Access, Store};

    use crate::suite::Fixture;

    async fn fixture() -> Fixture {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path(), Access::Server).await.unwrap();
        Fixture { store, dir, keep: Box::new(()) }
    }

    crate::suite::laws::all_laws!(fixture);
}

/// SQLite, with objects that are no files.
mod objects_elsewhere {
    use std::sync::Arc;

    use store::{Access, Location, Store};

    use crate::suite::Fixture;

    async fn fixture() -> Fixture {
        let dir = tempfile::tempdir().unwrap();
        let objects = Arc::new(object_store::memory::InMemory::new());
        let location = Location::in_folder(dir.path());
        let store = Store::open_with_objects(&location, Access::Server, objects).await.unwrap();
        Fixture { store, dir, keep: Box::new(()) }
    }

    crate::suite::laws::laws_of_objects!(fixture);
}
