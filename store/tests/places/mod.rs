//! The places of stores: a new one needs an empty place, and an old one its own.

mod databases;

use std::path::Path;
use std::time::Duration;

use store::{Access, Location, Store, StoreError, Sweeper};
use tempfile::TempDir;
use testbed::{Cluster, TestDatabase};

use crate::s3_server::S3Server;
use crate::suite::{alone, simulate};

/// A data folder, with PostgreSQL and a bucket if the test wants them.
struct Place {
    folder: TempDir,
    database: Option<TestDatabase>,
    bucket: Option<(S3Server, &'static str)>,
}

impl Place {
    fn in_folder() -> Self {
        Self { folder: tempfile::tempdir().unwrap(), database: None, bucket: None }
    }

    fn in_postgres() -> Self {
        Self { database: Some(Cluster::shared().database()), ..Self::in_folder() }
    }

    fn in_bucket(prefix: &'static str) -> Self {
        Self { bucket: Some((S3Server::start(), prefix)), ..Self::in_folder() }
    }

    fn location(&self, claimed: bool) -> Location {
        let database = self.database.as_ref().map(|database| database.url().parse().unwrap());
        let objects = self.bucket.as_ref().map(|(_, prefix)| S3Server::url(prefix));
        Location { database, objects, claimed, ..Location::in_folder(self.folder.path()) }
    }

    async fn open(&self, access: Access) -> Result<Store, StoreError> {
        self.open_at(&self.location(false), access).await
    }

    async fn claim(&self) -> Result<Store, StoreError> {
        self.open_at(&self.location(true), Access::Server).await
    }

    async fn open_at(&self, location: &Location, access: Access) -> Result<Store, StoreError> {
        match (&self.bucket, &location.objects) {
            (Some((server, _)), Some(url)) => {
                let objects = url.connect(&server.options(&[])).await?;
                Store::open_with_objects(location, access, objects).await
            }
            _ => Store::open_at(location, access).await,
        }
    }

    /// Where an object lies as a file.
    fn file(&self, name: &str) -> std::path::PathBuf {
        match &self.bucket {
            Some((server, prefix)) => server.file(&format!("{prefix}/{name}")),
            None => self.folder.path().join("objects").join(name),
        }
    }

    fn write(&self, name: &str, text: &str) {
        let file = self.file(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    }

    /// Opens the store, submits a job and closes it.
    async fn use_it(&self) {
        let store = self.open(Access::Server).await.unwrap();
        store.submit(alone(simulate(1))).await.unwrap();
        store.close().await;
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// Caught: a server took a colleague's folder over and deleted the files in it.
#[tokio::test(flavor = "multi_thread")]
async fn a_new_store_is_made_in_an_empty_place_or_in_a_confirmed_one() {
    for place in [Place::in_folder(), Place::in_postgres(), Place::in_bucket("lab")] {
        place.write("meshes/link1.stl", "mine");
        let error = place.open(Access::Server).await.unwrap_err();
        assert!(matches!(error, StoreError::Occupied { .. }), "{error}");
        let error = error.to_string();
        assert!(error.contains("meshes") && error.contains("--claim-place"), "{error}");
        assert!(!place.file("store.json").exists(), "nothing was written");
        place.claim().await.unwrap().close().await;
        // From here on it is an ordinary store.
        let store = place.open(Access::Server).await.unwrap();
        let mut sweeper = Sweeper::new(store.clone());
        tokio::time::sleep(Duration::from_millis(1100)).await;
        for _ in 0..2 {
            let swept = sweeper.sweep(Duration::ZERO).await.unwrap();
            assert_eq!((swept.deleted, swept.announced), (0, vec![]));
        }
        assert_eq!(std::fs::read_to_string(place.file("meshes/link1.stl")).unwrap(), "mine");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_prefix_inside_or_above_that_of_another_store_is_refused() {
    let place = Place::in_bucket("lab/arm");
    place.use_it().await;
    let (server, _) = place.bucket.as_ref().unwrap();
    for (prefix, is_refused) in
        [("", true), ("lab", true), ("lab/arm/panda", true), ("lab/leg", false), ("l", false)]
    {
        for claimed in [false, true] {
            let folder = tempfile::tempdir().unwrap();
            let url = S3Server::url(prefix);
            let objects = url.connect(&server.options(&[])).await.unwrap();
            let location =
                Location { objects: Some(url), claimed, ..Location::in_folder(folder.path()) };
            let opened = Store::open_with_objects(&location, Access::Server, objects).await;
            match opened {
                Ok(_) => {
                    assert!(!is_refused, "{prefix:?}");
                    // The next round makes it anew.
                    std::fs::remove_file(server.file(&format!("{prefix}/store.json"))).unwrap();
                }
                Err(StoreError::StoreAround { .. } | StoreError::StoreInside { .. }) => {
                    assert!(is_refused, "{prefix:?}");
                }
                Err(StoreError::Occupied { .. }) => assert!(is_refused && !claimed, "{prefix:?}"),
                Err(error) => panic!("{prefix:?}: {error}"),
            }
        }
    }
    place.open(Access::Server).await.unwrap();
}

/// Caught: a database whose disk was not mounted began with an empty folder and was "ok".
#[tokio::test(flavor = "multi_thread")]
async fn a_database_with_jobs_takes_no_empty_place_for_its_own() {
    for place in [Place::in_folder(), Place::in_postgres(), Place::in_bucket("lab")] {
        place.use_it().await;
        let mark = std::fs::read(place.file("store.json")).unwrap();
        let objects = place.file("store.json").parent().unwrap().to_owned();
        std::fs::remove_dir_all(&objects).unwrap();
        for access in [Access::Server, Access::Worker] {
            let error = place.open(access).await.unwrap_err();
            assert!(matches!(error, StoreError::FilesLost { .. }), "{error}");
            assert!(error.to_string().contains("mount the disk"), "{error}");
            let is_untouched = names_if_there(&objects).iter().all(|name| name == "probe");
            assert!(is_untouched, "written to {objects:?}: {:?}", names_if_there(&objects));
        }
        if place.bucket.is_none() {
            // An empty mount point, perhaps of a disk that was there a moment ago.
            std::fs::create_dir(&objects).unwrap();
            for access in [Access::Server, Access::Worker] {
                let error = place.open(access).await.unwrap_err();
                assert!(matches!(error, StoreError::FilesLost { .. }), "{error}");
                assert_eq!(names(&objects), Vec::<String>::new());
            }
        }
        // The files are lost, and somebody says so.
        place.claim().await.unwrap().close().await;
        assert_eq!(std::fs::read(place.file("store.json")).unwrap(), mark);
        place.open(Access::Worker).await.unwrap();
    }
}

fn names_if_there(folder: &Path) -> Vec<String> {
    if folder.exists() { names(folder) } else { Vec::new() }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_prefix_is_not_taken_for_the_place_of_a_store() {
    let place = Place { database: Some(Cluster::shared().database()), ..Place::in_bucket("lab") };
    place.use_it().await;
    let (server, _) = place.bucket.as_ref().unwrap();
    let wrong = Location { objects: Some(S3Server::url("other")), ..place.location(false) };
    for access in [Access::Server, Access::Worker] {
        let error = place.open_at(&wrong, access).await.unwrap_err();
        assert!(matches!(error, StoreError::FilesLost { .. }), "{error}");
    }
    assert!(!server.file("other/store.json").exists());
}

/// The disk of a folder is unmounted while a server and its workers run.
#[tokio::test(flavor = "multi_thread")]
async fn a_folder_that_vanishes_is_not_written_to() {
    let place = Place::in_postgres();
    let store = place.open(Access::Server).await.unwrap();
    let worker = place.open(Access::Worker).await.unwrap();
    let (here, away) = (place.folder.path().join("objects"), place.folder.path().join("away"));
    std::fs::rename(&here, &away).unwrap();
    for is_mount_point in [false, true] {
        if is_mount_point {
            std::fs::create_dir(&here).unwrap();
        }
        for store in [&store, &worker] {
            assert!(store.obstacle().unwrap().contains("store.json"));
            let writes = [
                store.put_object("datasets/1/a", "a".into()).await.map(drop),
                store.write_object("datasets/1/a").await.map(drop),
                store.begin_upload().await.map(drop),
                Sweeper::new(store.clone()).sweep(Duration::ZERO).await.map(drop),
                store.purge(store::Ripe::After(Duration::ZERO)).await.map(drop),
            ];
            for written in writes {
                let error = written.unwrap_err();
                assert!(matches!(error, StoreError::Displaced { .. }), "{error}");
            }
        }
        assert_eq!(here.exists(), is_mount_point);
        assert!(names_if_there(&here).is_empty());
    }
    // The disk of another store is mounted instead.
    std::fs::write(here.join("store.json"), format!("{{\"store\": \"{}\"}}", "ab".repeat(16)))
        .unwrap();
    assert!(store.obstacle().unwrap().contains("another store"));
    let error = Sweeper::new(store.clone()).sweep(Duration::ZERO).await.unwrap_err();
    assert!(matches!(error, StoreError::Displaced { .. }), "{error}");
    std::fs::remove_dir_all(&here).unwrap();
    std::fs::rename(&away, &here).unwrap();
    assert_eq!(store.obstacle(), None);
    worker.put_object("datasets/1/a", "a".into()).await.unwrap();
}
