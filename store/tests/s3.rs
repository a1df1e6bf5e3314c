//! Objects in an S3 server that refuses, cuts connections, sends wrong bytes and crashes.

#![expect(clippy::unwrap_used, reason = "tests")]

mod s3_server;

use std::io::{Read, Write};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use bytes::Bytes;
use futures::TryStreamExt;
use s3_server::{Asked, BUCKET, Fault, S3Server, Transport};
use spec::Digest;
use store::{
    Access, Location, ObjectsUrl, RemoteObjects, Store, StoreError, StoredObject, Sweeper,
};
use tempfile::TempDir;
use testbed::{Cluster, TestDatabase};

/// More than two parts.
const LARGE: usize = 20_000_000;

const MEDIUM: usize = 300_000;

struct Machine {
    store: Store,
    dir: TempDir,
}

/// A separate data folder, with objects in the server's bucket.
async fn machine(server: &S3Server, prefix: &str) -> Machine {
    with(server.objects(prefix).await, None).await
}

/// Two machines of one store.
async fn machines(server: &S3Server, database: &TestDatabase) -> (Machine, Machine) {
    let here = with(server.objects("arm").await, Some(database)).await;
    let there = with(server.objects("arm").await, Some(database)).await;
    (here, there)
}

async fn with(objects: RemoteObjects, database: Option<&TestDatabase>) -> Machine {
    let dir = tempfile::tempdir().unwrap();
    let database = database.map(|database| database.url().parse().unwrap());
    let location = Location { database, ..Location::in_folder(dir.path()) };
    let store = Store::open_with_objects(&location, Access::Server, objects).await.unwrap();
    Machine { store, dir }
}

fn bytes(length: usize) -> Bytes {
    (0..length).map(|i| u8::try_from(i % 251).unwrap()).collect()
}

impl Machine {
    async fn write(&self, path: &str, bytes: &Bytes) -> Result<StoredObject, StoreError> {
        let mut writer = self.store.write_object(path).await?;
        let bytes = bytes.clone();
        let write = move || {
            writer.write_all(&bytes).unwrap();
            writer.finish()
        };
        tokio::task::spawn_blocking(write).await.unwrap()
    }

    async fn download(
        &self,
        object: &StoredObject,
        range: Option<std::ops::Range<u64>>,
    ) -> Result<Vec<u8>, StoreError> {
        let bytes = self.store.open_object(object, range).await?;
        Ok(bytes.stream.try_collect::<Vec<Bytes>>().await?.concat())
    }

    /// Files of copies, whole and unfinished ones.
    fn copies(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.dir.path().join("cache")).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    /// Deletes the copies, so that the next reader fetches again.
    fn forget(&self) {
        for name in self.copies() {
            std::fs::remove_file(self.dir.path().join("cache").join(name)).unwrap();
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_store_that_cannot_be_used_is_refused_with_one_line_that_says_what_to_do() {
    let mut server = S3Server::start();
    let refused = async |url: &str, more: &[(&str, &str)], server: &S3Server| {
        let url: ObjectsUrl = url.parse().unwrap();
        let error = url.connect(&server.options(more)).await.unwrap_err();
        assert!(matches!(error, StoreError::ObjectsUnusable { .. }), "{error}");
        let line = faults(&error);
        assert!(!line.contains('\n') && line.contains(&url.to_string()), "{line}");
        assert!(line.contains(&server.endpoint()), "{line}");
        line
    };
    let wrong_key = [("AWS_ACCESS_KEY_ID", "nobody")];
    let wrong_secret = [("AWS_SECRET_ACCESS_KEY", "wrong")];
    for keys in [&wrong_key[..], &wrong_secret] {
        let line = refused("s3://lab/arm", keys, &server).await;
        assert!(
            line.ends_with(
                "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY to a pair that it knows"
            ),
            "{line}"
        );
    }
    let line = refused("s3://absent/arm", &[], &server).await;
    assert!(line.ends_with("the bucket does not exist; create it, or correct the URL"), "{line}");
    for (asked, operation) in [
        (Asked::List, "listing"),
        (Asked::Put, "writing"),
        (Asked::Get, "reading"),
        (Asked::Delete, "deleting"),
    ] {
        server.fail(asked, [Fault::Denied]);
        let line = refused("s3://lab/arm", &[], &server).await;
        assert!(line.contains(&format!("{operation} failed: the keys do not permit it")), "{line}");
    }
    server.fail(Asked::Get, [Fault::GarbleAnswer]);
    let line = refused("s3://lab/arm", &[], &server).await;
    assert!(line.ends_with("it returned other bytes than it was given"), "{line}");
    server.die();
    let line = refused("s3://lab/arm", &[], &server).await;
    assert!(line.contains("does not answer; check that it runs"), "{line}");
}

fn faults(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text.push_str(&format!(": {error}"));
        cause = error.source();
    }
    text
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_is_spoken_to_with_tls_when_its_certificate_is_trusted() {
    let server = S3Server::start_with(Transport::Tls);
    let url = S3Server::url("arm");
    let line = url.connect(&server.options(&[])).await.unwrap_err().to_string();
    assert!(line.contains("not trusted; set AWS_CA_BUNDLE"), "{line}");
    let authority = S3Server::authority();
    let trusted = [("AWS_CA_BUNDLE", authority.to_str().unwrap())];
    let machine = with(url.connect(&server.options(&trusted)).await.unwrap(), None).await;
    let object = machine.write("large", &bytes(LARGE)).await.unwrap();
    assert_eq!(machine.download(&object, None).await.unwrap(), bytes(LARGE));
    let absent = [("AWS_CA_BUNDLE", "/absent/ca.pem")];
    let line = url.connect(&server.options(&absent)).await.unwrap_err().to_string();
    assert!(
        line.starts_with("AWS_CA_BUNDLE is `/absent/ca.pem`, allowed: a file of PEM"),
        "{line}"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn workers_wait_while_the_store_fails() {
    let mut server = S3Server::start();
    let machine = machine(&server, "arm").await;
    assert_eq!(machine.store.obstacle(), None);
    server.die();
    let write = machine.store.put_object("small", bytes(1000));
    let noticed = async {
        loop {
            match machine.store.obstacle() {
                Some(obstacle) => return obstacle,
                None => tokio::time::sleep(Duration::from_millis(100)).await,
            }
        }
    };
    let (written, obstacle) = tokio::join!(write, async {
        let obstacle = noticed.await;
        server.come_back();
        obstacle
    });
    written.unwrap();
    assert!(obstacle.starts_with("the object store has refused or not answered for"), "{obstacle}");
    assert_eq!(machine.store.obstacle(), None);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn objects_lie_below_the_prefix_and_the_probe_leaves_nothing() {
    let server = S3Server::start();
    let machine = machine(&server, "arm/panda").await;
    machine.store.put_object("a/b", "torqued".into()).await.unwrap();
    assert_eq!(std::fs::read(server.file("arm/panda/a/b")).unwrap(), b"torqued");
    let probes = std::fs::read_dir(server.file("arm/panda/probe")).unwrap();
    assert_eq!(probes.count(), 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_a_busy_server_refuses_is_asked_for_again() {
    let server = S3Server::start();
    let machine = machine(&server, "arm").await;
    for asked in [Asked::Put, Asked::BeginParts, Asked::Part, Asked::Complete, Asked::Get] {
        server.fail(asked, [Fault::Busy; 3]);
    }
    let small = machine.store.put_object("small", bytes(1000)).await.unwrap();
    let large = machine.write("large", &bytes(LARGE)).await.unwrap();
    assert_eq!(machine.store.read_object(&small).await.unwrap(), bytes(1000));
    machine.forget();
    assert_eq!(machine.store.read_object(&large).await.unwrap(), bytes(LARGE));
    for asked in [Asked::Put, Asked::BeginParts, Asked::Part, Asked::Complete, Asked::Get] {
        assert_eq!(server.faults_left(asked), 0, "{asked:?}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_stays_busy_is_given_up_in_the_end() {
    let server = S3Server::start();
    let mut options = server.options(&[]);
    options.patience.retry_for = Duration::from_millis(300);
    let machine = with(S3Server::url("arm").connect(&options).await.unwrap(), None).await;
    server.fail(Asked::Part, [Fault::Busy; 1000]);
    let error = faults(&machine.write("d/large", &bytes(LARGE)).await.unwrap_err());
    for part in ["object d/large", &format!("/{BUCKET}/arm/d/large"), "503", "see its log"] {
        assert!(error.contains(part), "{error}");
    }
    assert!(!server.file("arm/d/large").exists());
    assert_eq!((server.parts_left(), machine.copies().len()), (0, 0), "given up in order");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn parts_that_break_off_are_sent_again() {
    let server = S3Server::start();
    let machine = machine(&server, "arm").await;
    server.fail(Asked::Part, [Fault::BreakOff, Fault::LoseAnswer, Fault::BreakOff]);
    let object = machine.write("large", &bytes(LARGE)).await.unwrap();
    assert_eq!((object.size, object.sha256), (LARGE as u64, Digest::of(&bytes(LARGE))));
    assert_eq!(std::fs::read(server.file("arm/large")).unwrap(), bytes(LARGE));
    assert_eq!((server.faults_left(Asked::Part), server.parts_left()), (0, 0));
}

/// Caught: an object was refused on the second attempt, after the answer to the first was lost.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_object_whose_answer_was_lost_is_there() {
    let server = S3Server::start();
    let machine = machine(&server, "arm").await;
    server.fail(Asked::Put, [Fault::LoseAnswer]);
    machine.store.put_object("small", bytes(1000)).await.unwrap();
    server.fail(Asked::Complete, [Fault::LoseAnswer]);
    let large = machine.write("large", &bytes(LARGE)).await.unwrap();
    machine.forget();
    assert_eq!(machine.store.read_object(&large).await.unwrap(), bytes(LARGE));
    assert_eq!(server.parts_left(), 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_dies_and_comes_back_loses_nothing() {
    let mut server = S3Server::start();
    let machine = machine(&server, "arm").await;
    let before = machine.write("before", &bytes(LARGE)).await.unwrap();
    server.die();
    let (store, dir) = (machine.store.clone(), machine.dir);
    let machine = Arc::new(Machine { store, dir });
    let meanwhile = tokio::spawn({
        let machine = Arc::clone(&machine);
        async move { machine.write("meanwhile", &bytes(LARGE)).await }
    });
    tokio::time::sleep(Duration::from_millis(300)).await;
    assert!(!meanwhile.is_finished(), "it waits");
    server.come_back();
    let meanwhile = meanwhile.await.unwrap().unwrap();
    for object in [before, meanwhile] {
        assert_eq!(machine.download(&object, None).await.unwrap(), bytes(LARGE));
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_dies_in_the_middle_of_an_upload_has_no_half_of_it() {
    let mut server = S3Server::start();
    let machine = Arc::new(machine(&server, "arm").await);
    server.fail(Asked::Complete, [Fault::Busy; 3]);
    let write = tokio::spawn({
        let machine = Arc::clone(&machine);
        async move { machine.write("large", &bytes(LARGE)).await }
    });
    while server.faults_left(Asked::Complete) > 1 {
        assert!(!server.file("arm/large").exists());
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    server.die();
    tokio::time::sleep(Duration::from_millis(50)).await;
    assert!(!server.file("arm/large").exists());
    server.come_back();
    let object = write.await.unwrap().unwrap();
    assert_eq!(machine.download(&object, None).await.unwrap(), bytes(LARGE));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_answer_that_breaks_off_is_fetched_to_its_end() {
    let server = S3Server::start();
    let machine = machine(&server, "arm").await;
    let object = machine.store.put_object("a", bytes(MEDIUM)).await.unwrap();
    for faults in [
        &[Fault::CutAnswer(0)][..],
        &[Fault::CutAnswer(100_000), Fault::CutAnswer(7), Fault::CutAnswer(1)],
        &[Fault::StallAnswer(100_000), Fault::StallAnswer(0)],
        &[Fault::CutAnswer(1000), Fault::Busy, Fault::Busy, Fault::StallAnswer(5)],
        &[Fault::DripAnswer],
    ] {
        server.fail(Asked::Get, faults.iter().copied());
        machine.forget();
        assert_eq!(machine.store.read_object(&object).await.unwrap(), bytes(MEDIUM), "{faults:?}");
        server.fail(Asked::Get, faults.iter().copied());
        assert_eq!(machine.download(&object, None).await.unwrap(), bytes(MEDIUM), "{faults:?}");
        assert_eq!(server.faults_left(Asked::Get), 0, "{faults:?}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_truncated_or_garbled_answer_is_never_taken_for_the_object() {
    let server = S3Server::start();
    let machine = machine(&server, "arm").await;
    for (place, fault) in [Fault::ShortenAnswer(1000), Fault::GarbleAnswer].into_iter().enumerate()
    {
        let path = |name: &str| format!("{place}/{name}");
        let object = machine.store.put_object(&path("a"), bytes(MEDIUM)).await.unwrap();
        server.fail(Asked::Get, [fault]);
        assert_eq!(machine.store.read_object(&object).await.unwrap(), bytes(MEDIUM), "{fault:?}");
        machine.forget();
        server.fail(Asked::Get, [fault; 2]);
        let error = machine.store.read_object(&object).await.unwrap_err();
        assert!(matches!(error, StoreError::DamagedObject { .. }), "{fault:?}: {error}");
        assert_eq!(machine.copies(), Vec::<String>::new(), "{fault:?}");

        let object = machine.store.put_object(&path("b"), bytes(MEDIUM)).await.unwrap();
        server.fail(Asked::Get, [fault]);
        let error = machine.download(&object, None).await.unwrap_err();
        assert_eq!(error.object_path(), Some(path("b").as_str()), "{fault:?}: {error}");
    }
    assert_eq!(server.faults_left(Asked::Get), 0);
    let object = machine.store.put_object("c", bytes(MEDIUM)).await.unwrap();
    // The first range starts a background read of the whole object.
    server.fail(Asked::Get, [Fault::ShortenAnswer(1000); 2]);
    assert!(machine.download(&object, Some(0..2000)).await.is_err());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_object_is_fetched_once_by_a_machine_however_often_it_is_opened() {
    let (server, database) = (S3Server::start(), Cluster::shared().database());
    let (here, there) = machines(&server, &database).await;
    let object = here.write("a", &bytes(MEDIUM)).await.unwrap();
    let asked = server.count(Asked::Get);
    let opened = (0..8).map(|_| there.store.read_object(&object));
    for read in futures::future::join_all(opened).await {
        assert_eq!(read.unwrap(), bytes(MEDIUM));
    }
    assert_eq!(server.count(Asked::Get) - asked, 1);
    assert_eq!(there.copies(), [object.sha256.to_string()]);
    // The writer of an object need not fetch it.
    assert_eq!(here.store.read_object(&object).await.unwrap(), bytes(MEDIUM));
    assert_eq!(server.count(Asked::Get) - asked, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_object_that_is_wanted_soon_is_there_before_it_is_opened() {
    let mut server = S3Server::start();
    let machine = machine(&server, "arm").await;
    let object = machine.store.put_object("a", bytes(MEDIUM)).await.unwrap();
    machine.store.fetch_ahead(&object);
    while machine.copies() != [object.sha256.to_string()] {
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    server.die();
    assert_eq!(machine.store.read_object(&object).await.unwrap(), bytes(MEDIUM));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_object_never_takes_the_place_of_another_one() {
    let (server, database) = (S3Server::start(), Cluster::shared().database());
    let (one, other) = machines(&server, &database).await;
    let first = one.store.put_object("small", bytes(1000)).await.unwrap();
    assert_eq!(other.store.put_object("small", bytes(1000)).await.unwrap(), first);
    let large = one.write("large", &bytes(LARGE)).await.unwrap();
    assert_eq!(other.write("large", &bytes(LARGE)).await.unwrap(), large);
    let taken = [
        other.store.put_object("small", bytes(999)).await.unwrap_err(),
        other.write("large", &bytes(LARGE + 1)).await.unwrap_err(),
    ];
    for error in taken {
        assert!(matches!(error, StoreError::ObjectTaken { .. }), "{error}");
        assert!(error.to_string().contains("give each a prefix of its own"), "{error}");
    }
    assert_eq!(one.download(&large, None).await.unwrap(), bytes(LARGE));
    assert_eq!(server.parts_left(), 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_store_without_conditions_is_written_to_when_that_is_said() {
    let server = S3Server::start();
    let options = server.options(&[("AWS_CONDITIONAL_PUT", "disabled")]);
    let machine = with(S3Server::url("arm").connect(&options).await.unwrap(), None).await;
    machine.store.put_object("small", bytes(1000)).await.unwrap();
    machine.store.put_object("small", bytes(999)).await.unwrap();
    let object = machine.write("large", &bytes(LARGE)).await.unwrap();
    assert_eq!(machine.download(&object, None).await.unwrap(), bytes(LARGE));
}

const OLD: &str = "uploads/upload-1-2-3";
const YOUNG: &str = "uploads/upload-4-5-6";

/// The age does not depend on the clock of the machine that sweeps.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn orphans_are_as_old_as_the_store_says() {
    let server = S3Server::start();
    let machine = machine(&server, "arm").await;
    machine.store.put_object(OLD, bytes(1000)).await.unwrap();
    machine.store.put_object(YOUNG, bytes(1000)).await.unwrap();
    let age = |path: &str, age: Duration| {
        let file =
            std::fs::File::options().write(true).open(server.file(&format!("arm/{path}"))).unwrap();
        file.set_modified(SystemTime::now() - age).unwrap();
    };
    age(OLD, Duration::from_secs(7200));
    age(YOUNG, Duration::from_secs(1800));
    for asked in [Asked::Head, Asked::List] {
        server.fail(asked, [Fault::OtherClock]);
    }
    let mut sweeper = Sweeper::new(machine.store.clone());
    assert_eq!(sweeper.sweep(Duration::from_secs(3600)).await.unwrap().announced, [OLD]);
    assert_eq!((server.faults_left(Asked::Head), server.faults_left(Asked::List)), (0, 0));
    assert_eq!(sweeper.sweep(Duration::from_secs(3600)).await.unwrap().deleted, 1);
    assert!(!server.file(&format!("arm/{OLD}")).exists());
    assert!(server.file(&format!("arm/{YOUNG}")).exists());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_sweep_leaves_the_objects_of_other_prefixes() {
    let server = S3Server::start();
    let (arm, leg) = (machine(&server, "arm").await, machine(&server, "arm-2").await);
    arm.store.put_object(OLD, bytes(10)).await.unwrap();
    leg.store.put_object(OLD, bytes(10)).await.unwrap();
    tokio::time::sleep(Duration::from_millis(1100)).await;
    let mut sweeper = Sweeper::new(arm.store.clone());
    sweeper.sweep(Duration::ZERO).await.unwrap();
    assert_eq!(sweeper.sweep(Duration::ZERO).await.unwrap().deleted, 1);
    assert!(!server.file(&format!("arm/{OLD}")).exists());
    assert!(server.file(&format!("arm-2/{OLD}")).exists());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_upload_that_breaks_off_leaves_nothing() {
    let server = S3Server::start();
    let machine = machine(&server, "arm").await;
    let mut writer = machine.store.begin_upload().await.unwrap();
    writer.write(&bytes(LARGE)).await.unwrap();
    assert_eq!(machine.copies().len(), 1);
    drop(writer);
    assert_eq!(machine.copies().len(), 0);

    let mut writer = machine.store.begin_upload().await.unwrap();
    writer.write(&bytes(LARGE)).await.unwrap();
    let upload = writer.finish("arm.csv").await.unwrap();
    let mut file = machine.store.open_upload(&upload).unwrap();
    let mut read = Vec::new();
    file.read_to_end(&mut read).unwrap();
    assert_eq!(read, bytes(LARGE));
}

/// A missing bucket must not count as lost objects.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_bucket_that_vanished_is_not_taken_for_lost_objects() {
    let server = S3Server::start();
    let machine = machine(&server, "arm").await;
    let object = machine.store.put_object("a", bytes(MEDIUM)).await.unwrap();
    machine.forget();
    server.fail(Asked::Get, [Fault::NoBucket]);
    let error = machine.store.read_object(&object).await.unwrap_err();
    assert!(!error.is_missing_file() && error.to_string().contains("the bucket does not exist"));
    std::fs::remove_file(server.file("arm/a")).unwrap();
    let error = machine.store.read_object(&object).await.unwrap_err();
    assert!(error.is_missing_file(), "{error}");
}
