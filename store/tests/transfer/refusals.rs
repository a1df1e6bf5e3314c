//! Moves that are refused, with their reasons.

use spec::Resources;
use store::{Access, Duty, Location, Store, StoreError};
use testbed::Cluster;

use super::{Places, sqlite};
use crate::suite::workers::worker;
use crate::suite::{LONG, alone, simulate};

impl Places {
    async fn refusal(&self, from: &Location, to: &Location) -> String {
        self.transfer(from, to).await.unwrap_err().to_string()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_folder_with_a_server_stays() {
    let places = Places::filled().await;
    let _server = Store::open_at(&places.first(), Access::Server).await.unwrap();
    let error = places.refusal(&places.first(), &places.postgres()).await;
    assert!(error.contains("is in use by another torqued server (pid "), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_postgresql_with_a_server_neither_moves_nor_is_moved_to() {
    let places = Places::filled().await;
    let server = Store::open_at(&places.postgres(), Access::Server).await.unwrap();
    let (mut reaping, mut sweeping) = (server.duty(Duty::Reaping), server.duty(Duty::Sweeping));
    assert!(reaping.is_mine().await.unwrap() && sweeping.is_mine().await.unwrap());
    let error = places.refusal(&places.postgres(), &places.last()).await;
    assert!(error.contains("is in use by a server; let its tasks end"), "{error}");
    let error = places.refusal(&places.first(), &places.postgres()).await;
    assert!(error.contains("is in use by a server; stop it first"), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_store_with_a_worker_or_a_running_task_stays() {
    let places = Places::filled().await;
    let store = Store::open_at(&places.first(), Access::Worker).await.unwrap();
    store.register_worker(&worker("w7", 4711)).await.unwrap();
    let error = places.refusal(&places.first(), &places.postgres()).await;
    assert!(error.contains("is in use by worker w7 (pid 4711 on lab-3)"), "{error}");
    store.forget_worker(&worker("w7", 4711)).await.unwrap();
    store.resume_queue().await.unwrap();
    let task = store.claim("w7", &Resources::default(), LONG).await.unwrap().unwrap();
    let error = places.refusal(&places.first(), &places.postgres()).await;
    let named = format!("worker w7, which has task {} ({}) of job", task.fence.task, task.label);
    assert!(error.contains(&named) && error.contains("torqued pause --wait"), "{error}");
    store.release(task.fence).await.unwrap();
    places.transfer(&places.first(), &places.postgres()).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_place_with_jobs_is_not_moved_to() {
    let places = Places::filled().await;
    let other = Store::open_at(&places.postgres(), Access::Server).await.unwrap();
    other.submit(alone(simulate(5))).await.unwrap();
    other.close().await;
    drop(other);
    let error = places.refusal(&places.first(), &places.postgres()).await;
    assert!(error.contains("has 1 job already; choose an empty place"), "{error}");
    Store::open_at(&places.postgres(), Access::Server).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_place_with_a_worker_is_not_moved_to() {
    let places = Places::filled().await;
    let other = Store::open_at(&places.postgres(), Access::Server).await.unwrap();
    other.register_worker(&worker("w7", 4711)).await.unwrap();
    let error = places.refusal(&places.first(), &places.postgres()).await;
    assert!(error.contains("worker w7 (pid 4711 on lab-3); stop it first"), "{error}");
    other.forget_worker(&worker("w7", 4711)).await.unwrap();
    places.transfer(&places.first(), &places.postgres()).await.unwrap();
}

/// A server there would delete files that are not objects of its store.
#[tokio::test(flavor = "multi_thread")]
async fn a_bucket_with_files_of_somebody_else_is_not_moved_to() {
    let places = Places::filled().await;
    let file = places.bucket.file("arm/thesis.pdf");
    std::fs::create_dir(file.parent().unwrap()).unwrap();
    std::fs::write(&file, "draft").unwrap();
    let error = places.refusal(&places.first(), &places.postgres_and_s3()).await;
    assert!(error.contains("has thesis.pdf already"), "{error}");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "draft");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_one_store_began_to_move_no_other_goes_on_with() {
    let (places, others) = (Places::filled().await, Places::filled().await);
    drop(places.prepare(&places.first(), &places.postgres()).await.unwrap());
    let error = places.refusal(&others.first(), &places.postgres()).await;
    assert!(error.contains("has a part of another store already"), "{error}");
    places.transfer(&places.first(), &places.postgres()).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_store_does_not_move_to_where_it_is() {
    let places = Places::filled().await;
    let same_folder = Location { folder: places.first().folder, ..places.postgres() };
    for to in [places.first(), same_folder] {
        let error = places.refusal(&places.first(), &to).await;
        assert!(error.contains("shares a folder, the database or a prefix"), "{error}");
    }
    places.transfer(&places.first(), &places.postgres()).await.unwrap();
    let same_database = Location { folder: places.last().folder, ..places.postgres() };
    let error = places.transfer(&places.postgres(), &same_database).await.unwrap_err();
    assert!(matches!(error, StoreError::SharedPlace { .. }), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn schemas_of_other_versions_stay_as_they_are() {
    let places = Places::filled().await;
    let cluster = Cluster::shared();
    Store::open_at(&places.postgres(), Access::Server).await.unwrap().close().await;
    let newer = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) \
                 VALUES (99, 'from the future', true, '', 0)";
    cluster.psql(places.database.name(), newer);
    let error = places.refusal(&places.first(), &places.postgres()).await;
    assert!(error.contains("was made by a newer torqued (schema 99"), "{error}");
    cluster.psql(places.database.name(), "DELETE FROM _sqlx_migrations WHERE version = 99");
    let mut connection = sqlite(places.first.path()).await;
    let older = "DELETE FROM _sqlx_migrations WHERE version > 16; \
                 UPDATE _sqlx_migrations SET version = 1";
    sqlx::raw_sql(older).execute(&mut connection).await.unwrap();
    let error = places.refusal(&places.first(), &places.postgres()).await;
    assert!(error.contains("has schema 1 of an unreleased torqued"), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_table_that_nobody_thought_of_is_not_left_behind() {
    let places = Places::filled().await;
    let mut connection = sqlite(places.first.path()).await;
    sqlx::query("CREATE TABLE extra (id INTEGER)").execute(&mut connection).await.unwrap();
    let error = places.refusal(&places.first(), &places.postgres()).await;
    assert!(error.contains("has extra, which this torqued cannot move"), "{error}");
    sqlx::query("DROP TABLE extra").execute(&mut connection).await.unwrap();
    sqlx::query("ALTER TABLE job ADD COLUMN extra TEXT").execute(&mut connection).await.unwrap();
    let error = places.refusal(&places.first(), &places.postgres()).await;
    assert!(error.contains("has job.extra, which this torqued cannot move"), "{error}");
}
