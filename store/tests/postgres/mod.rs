//! Laws of PostgreSQL alone: access, housekeeping, and work while the database is away.

use std::sync::Arc;
use std::time::{Duration, Instant};

use sqlx::{Connection, Executor, PgConnection};
use store::{
    Access, Duty, Fence, Lease, Location, Metric, NewJob, Progress, Reaper, Store, StoreError,
    TaskState,
};
use tempfile::TempDir;
use testbed::{Cluster, Durability, TestDatabase};

use crate::suite::{Fixture, LONG, alone, files_of, simulate, task, train};

async fn fixture() -> Fixture {
    let (location, database, dir) = empty();
    let store = Store::open_at(&location, Access::Server).await.unwrap();
    Fixture { store, objects: files_of(&dir), dir, keep: Box::new(database) }
}

crate::suite::laws::all_laws!(fixture);

/// A database without a schema, and a folder.
fn empty() -> (Location, TestDatabase, TempDir) {
    let database = Cluster::shared().database();
    let dir = tempfile::tempdir().unwrap();
    (at(&database.url(), &dir), database, dir)
}

fn at(url: &str, dir: &TempDir) -> Location {
    Location { database: Some(url.parse().unwrap()), ..Location::in_folder(dir.path()) }
}

async fn refusal(url: &str, access: Access) -> String {
    let dir = tempfile::tempdir().unwrap();
    Store::open_at(&at(url, &dir), access).await.unwrap_err().to_string()
}

#[tokio::test(flavor = "multi_thread")]
async fn who_is_not_let_in_is_told_what_to_do() {
    let cluster = Cluster::shared();
    let database = cluster.database();
    cluster.psql("postgres", "DO $$ BEGIN CREATE ROLE lab LOGIN PASSWORD 'right'; EXCEPTION WHEN duplicate_object THEN NULL; END $$");
    let with_password = |password: &str| cluster.url(&format!("lab:{password}"), database.name());
    let error = refusal(&with_password("wrong"), Access::Server).await;
    assert!(error.contains("check the user \"lab\" and the password"), "{error}");
    assert!(!error.contains("wrong"), "{error}");
    let error = refusal(&with_password("right"), Access::Server).await;
    assert!(error.contains("GRANT CREATE ON SCHEMA public TO lab"), "{error}");
    let error = refusal(&cluster.url("postgres", "nowhere"), Access::Server).await;
    assert!(error.contains("create it first: createdb nowhere"), "{error}");
    let error = refusal(&database.url(), Access::Worker).await;
    assert!(error.contains("has no store; start a server on it first"), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_schema_of_another_version_is_left_alone() {
    let cluster = Cluster::shared();
    let (location, database, dir) = empty();
    Store::open_at(&location, Access::Server).await.unwrap().close().await;
    let newer = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) \
                 VALUES (99, 'from the future', true, '', 0)";
    cluster.psql(database.name(), newer);
    for access in [Access::Server, Access::Worker] {
        let error = Store::open_at(&location, access).await.unwrap_err();
        assert!(error.to_string().contains("was made by a newer torqued (schema 99"), "{error}");
    }
    cluster.psql(database.name(), "DELETE FROM _sqlx_migrations WHERE version > 13");
    cluster.psql(database.name(), "UPDATE _sqlx_migrations SET version = 12");
    for access in [Access::Server, Access::Worker] {
        let error = Store::open_at(&location, access).await.unwrap_err();
        let expected = "has schema 12 of an unreleased torqued, and this one opens schema 13";
        assert!(error.to_string().contains(expected), "{error}");
    }
    cluster.psql(database.name(), "DELETE FROM _sqlx_migrations");
    let error = Store::open_at(&location, Access::Worker).await.unwrap_err();
    assert!(error.to_string().contains("has no store; start a server on it first"), "{error}");
    drop(dir);
}

/// Ids are assigned in another order than transactions commit.
#[tokio::test(flavor = "multi_thread")]
async fn an_event_is_not_told_before_one_with_a_smaller_id_that_is_still_being_written() {
    const INSERT: &str =
        "INSERT INTO event (at, kind, job, data) VALUES (0, 'job', 1, '{}') RETURNING id";
    let (location, database, _dir) = empty();
    let store = Store::open_at(&location, Access::Server).await.unwrap();
    let mut tail = store.event_tail().await.unwrap().unwrap();
    let url = database.url();
    let mut slow = PgConnection::connect(&url).await.unwrap();
    let mut fast = PgConnection::connect(&url).await.unwrap();
    for end in ["COMMIT", "ROLLBACK"] {
        slow.execute("BEGIN").await.unwrap();
        let first: i64 = sqlx::query_scalar(INSERT).fetch_one(&mut slow).await.unwrap();
        // No transaction with a larger number has ended yet.
        assert_eq!(tail.read().await.unwrap(), []);
        let second: i64 = sqlx::query_scalar(INSERT).fetch_one(&mut fast).await.unwrap();
        assert!(first < second);
        let (_, newest) = store.kept_events().await.unwrap();
        assert_eq!(newest, second, "it is there to be read");
        for _ in 0..20 {
            assert_eq!(tail.read().await.unwrap(), [], "{first} may come");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        slow.execute(end).await.unwrap();
        let began = Instant::now();
        let mut told = Vec::new();
        while !told.contains(&second) {
            assert!(began.elapsed() < Duration::from_secs(60), "nobody writes any more");
            told.extend(tail.read().await.unwrap().iter().map(|event| event.id));
        }
        assert_eq!(told, if end == "COMMIT" { vec![first, second] } else { vec![second] });
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn servers_that_start_together_make_one_schema() {
    let (location, _database, _dir) = empty();
    let begun: Vec<_> = (0..4)
        .map(|_| {
            let location = location.clone();
            tokio::spawn(async move { Store::open_at(&location, Access::Server).await })
        })
        .collect();
    let mut identities = Vec::new();
    for store in begun {
        identities.push(store.await.unwrap().unwrap().identity().await.unwrap());
    }
    identities.dedup();
    assert_eq!(identities.len(), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn one_of_two_servers_keeps_house_and_the_other_takes_over() {
    let (location, _database, _dir) = empty();
    let first = Store::open_at(&location, Access::Server).await.unwrap();
    let second = Store::open_at(&location, Access::Server).await.unwrap();
    let (mut of_first, mut of_second) = (first.duty(Duty::Reaping), second.duty(Duty::Reaping));
    assert!(of_first.is_mine().await.unwrap());
    assert!(!of_second.is_mine().await.unwrap());
    assert!(second.duty(Duty::Sweeping).is_mine().await.unwrap());
    assert!(of_first.is_mine().await.unwrap());
    drop(of_first);
    let began = Instant::now();
    while !of_second.is_mine().await.unwrap() {
        assert!(began.elapsed() < LONG);
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn objects_of_another_database_are_refused() {
    let (location, _database, dir) = empty();
    Store::open_at(&location, Access::Server).await.unwrap();
    let other = Cluster::shared().database();
    let error = Store::open_at(&at(&other.url(), &dir), Access::Server).await.unwrap_err();
    assert!(matches!(error, StoreError::ForeignObjects { .. }), "{error}");
    let error = Store::open(dir.path(), Access::Server).await.unwrap_err();
    assert!(matches!(error, StoreError::DatabaseLost { .. }), "{error}");
    assert!(error.to_string().contains("name it with --database"), "{error}");
    assert!(!dir.path().join("torqued.sqlite").exists(), "nothing was made");
}

async fn running(store: &Store) -> Fence {
    store.submit(alone(train(&simulate(1), vec![]))).await.unwrap();
    store.claim("w1", &spec::Resources::default(), LONG).await.unwrap().unwrap().fence
}

/// Looks for a task, claims it and completes it.
async fn do_one(worker: &Store) {
    let nothing = spec::Resources::default();
    assert!(worker.poll("w1", &nothing).await.unwrap().is_any_claimable);
    let task = worker.claim("w1", &nothing, LONG).await.unwrap().unwrap();
    worker.complete(task.fence, None).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_does_its_tasks_on_one_connection_and_replaces_a_broken_one() {
    let (location, database, _dir) = empty();
    let server = Store::open_at(&location, Access::Server).await.unwrap();
    let tasks = (0..20).map(|shard| task(0, shard, 2)).collect();
    server.submit(alone(NewJob { tasks, ..simulate(1) })).await.unwrap();
    server.close().await;
    let cluster = Cluster::shared();
    let of_torqued = |query: &str| {
        let from = "FROM pg_stat_activity \
                    WHERE datname = current_database() AND application_name = 'torqued'";
        cluster.psql(database.name(), &format!("SELECT {query} {from}"))
    };
    // The database ends a session some time after its client closed the connection. An idle
    // connection in the worker's pool would stay for half a minute.
    let wait_until_sessions_are = |expected: &str| {
        let began = Instant::now();
        while of_torqued("count(*)") != expected {
            let waited = began.elapsed();
            assert!(waited < Duration::from_secs(10), "{} sessions", of_torqued("count(*)"));
        }
    };
    wait_until_sessions_are("0");
    let worker = Store::open_at(&location, Access::Worker).await.unwrap();
    for _ in 0..10 {
        do_one(&worker).await;
    }
    wait_until_sessions_are("1");
    of_torqued("pg_terminate_backend(pid)");
    wait_until_sessions_are("0");
    // A connection that was just used is not tested.
    tokio::time::sleep(Duration::from_millis(300)).await;
    for _ in 0..9 {
        do_one(&worker).await;
    }
    wait_until_sessions_are("1");
    tokio::time::timeout(LONG, worker.close()).await.unwrap();
}

/// The database goes away during all kinds of work for longer than a lease, and comes back.
#[tokio::test(flavor = "multi_thread")]
async fn work_waits_for_a_database_that_went_away() {
    let mut cluster = Cluster::start(Durability::None);
    let dir = tempfile::tempdir().unwrap();
    let location = at(&cluster.url("postgres", "postgres"), &dir);
    let server = Store::open_at(&location, Access::Server).await.unwrap();
    let worker = Store::open_at(&location, Access::Worker).await.unwrap();
    let fence = running(&worker).await;
    cluster.crash();
    let error = server.check_database().await.unwrap_err();
    assert!(
        matches!(error, StoreError::Database { .. } | StoreError::DatabaseBusy { .. }),
        "{error}"
    );
    let record = {
        let worker = worker.clone();
        tokio::spawn(async move {
            let point = Metric { key: "loss".to_owned(), step: 1, value: 0.5 };
            worker.record_metrics(fence, &[point]).await
        })
    };
    tokio::time::sleep(Duration::from_secs(3)).await;
    assert!(!record.is_finished(), "what was made waits");
    cluster.restart();
    record.await.unwrap().unwrap();
    let mut reaper = Reaper::new(server.clone(), Duration::from_secs(1));
    assert_eq!(reaper.look(Duration::from_secs(1)).await.unwrap().queued, 0);
    let lease = worker.renew(fence, LONG, &Progress::default()).await.unwrap();
    assert!(matches!(lease, Lease::Held { .. }));
    worker.complete(fence, None).await.unwrap();
    assert_eq!(server.task(fence.task).await.unwrap().state, TaskState::Succeeded);
    server.check_database().await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_that_listens_hears_of_a_task_through_a_database_that_was_away() {
    let mut cluster = Cluster::start(Durability::None);
    let dir = tempfile::tempdir().unwrap();
    let location = at(&cluster.url("postgres", "postgres"), &dir);
    let store = Arc::new(Store::open_at(&location, Access::Server).await.unwrap());
    let mut bell = store.bell().await.unwrap();
    cluster.crash();
    // A broken connection counts as a ring, and is opened again.
    let _ = bell.wait(LONG).await;
    cluster.restart();
    let mut bell = store.bell().await.unwrap();
    let submit = async {
        tokio::time::sleep(Duration::from_millis(50)).await;
        store.submit(alone(train(&simulate(1), vec![]))).await.unwrap();
    };
    let heard = tokio::time::timeout(LONG, bell.wait(LONG));
    let (heard, ()) = tokio::join!(heard, submit);
    heard.unwrap().unwrap();
    assert!(store.claim("w1", &spec::Resources::default(), LONG).await.unwrap().is_some());
}
