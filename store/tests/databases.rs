//! Runs the laws of the store with every supported database and object store.

#![expect(clippy::unwrap_used, reason = "tests")]

mod places;
mod postgres;
#[expect(dead_code, reason = "tests/s3.rs has it fail")]
mod s3_server;
mod schema;
mod suite;
mod transfer;

/// SQLite, with objects in the data folder.
mod sqlite {
    use store::{Access, Store};

    use crate::suite::{Fixture, files_of};

    async fn fixture() -> Fixture {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path(), Access::Server).await.unwrap();
        Fixture { store, objects: files_of(&dir), dir, keep: Box::new(()) }
    }

    crate::suite::laws::all_laws!(fixture);
}

/// SQLite, with objects that are no files.
mod objects_elsewhere {
    use std::sync::Arc;

    use object_store::ObjectStore;
    use object_store::memory::InMemory;
    use store::{Access, Location, Store};

    use crate::suite::Fixture;

    async fn fixture() -> Fixture {
        let dir = tempfile::tempdir().unwrap();
        let objects: Arc<dyn ObjectStore> = Arc::new(InMemory::new());
        let (location, remote) = (Location::in_folder(dir.path()), objects.clone().into());
        let store = Store::open_with_objects(&location, Access::Server, remote).await.unwrap();
        Fixture { store, objects, dir, keep: Box::new(()) }
    }

    crate::suite::laws::laws_of_objects!(fixture);
}

/// PostgreSQL, with objects in a bucket.
mod objects_in_s3 {
    use store::{Access, Location, Store};
    use testbed::Cluster;

    use crate::s3_server::S3Server;
    use crate::suite::Fixture;

    async fn fixture() -> Fixture {
        let (server, database) = (S3Server::start(), Cluster::shared().database());
        let remote = server.objects("suite").await;
        let dir = tempfile::tempdir().unwrap();
        let location = Location {
            database: Some(database.url().parse().unwrap()),
            ..Location::in_folder(dir.path())
        };
        let store = Store::open_with_objects(&location, Access::Server, remote).await.unwrap();
        let unconditional = server.options(&[("AWS_CONDITIONAL_PUT", "disabled")]);
        let objects = S3Server::url("suite").connect(&unconditional).await.unwrap().store();
        Fixture { store, objects, dir, keep: Box::new((server, database)) }
    }

    crate::suite::laws::laws_of_objects!(fixture);
}
