//! Backups: copies of a store that is in use.

use sqlx::AssertSqlSafe;
use store::{Access, Location, StoreError, Transfer, TransferProgress};

use super::{Places, sqlite};
use crate::suite::{alone, simulate};

impl Places {
    async fn prepare_backup(&self, from: &Location, to: &Location) -> Transfer {
        Transfer::prepare_backup(from, to, &self.bucket.options(&[])).await.unwrap()
    }
}

/// Makes a backup of a store during writes.
async fn back_up(places: &Places, from: &Location, to: &Location) {
    let server = places.open(from, Access::Worker).await.unwrap();
    let before = server.tokens().await.unwrap().len();
    let transfer = places.prepare_backup(from, to).await;
    let contents = transfer.contents();
    // Writes after the backup's moment are not part of it.
    let late = server.submit(alone(simulate(99))).await.unwrap().job;
    server.forget_tokens().await.unwrap();
    let progress = TransferProgress::default();
    transfer.run(&progress).await.unwrap();
    assert_eq!((progress.bytes(), progress.rows()), (contents.bytes, contents.rows));
    let copy = places.open(to, Access::Server).await.unwrap();
    assert!(matches!(copy.job(late).await, Err(StoreError::NotFound { .. })));
    assert_eq!(copy.tokens().await.unwrap().len(), before);
    assert!(copy.workers().await.unwrap().is_empty(), "they work for the source");
    assert!(!server.workers().await.unwrap().is_empty());
    copy.close().await;
    server.job(late).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_folder_is_saved_beside_those_who_write() {
    let places = Places::filled().await;
    back_up(&places, &places.first(), &places.last()).await;
    assert!(places.objects(&places.last()) == places.objects(&places.first()));
}

#[tokio::test(flavor = "multi_thread")]
async fn postgresql_with_a_bucket_is_saved_beside_those_who_write() {
    let places = Places::filled().await;
    let lab = places.postgres_and_s3();
    places.transfer(&places.first(), &lab).await.unwrap();
    back_up(&places, &lab, &places.last()).await;
    assert!(places.objects(&places.last()) == places.objects(&lab));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_checkpoint_that_is_deleted_meanwhile_is_left_out_and_a_lost_file_is_an_error() {
    let places = Places::filled().await;
    let (from, to) = (places.first(), places.last());
    let transfer = places.prepare_backup(&from, &to).await;
    let mut connection = sqlite(places.first.path()).await;
    let (id, path): (i64, String) =
        sqlx::query_as("SELECT checkpoint, path FROM checkpoint_file ORDER BY path LIMIT 1")
            .fetch_one(&mut connection)
            .await
            .unwrap();
    std::fs::remove_file(places.first.path().join("objects").join(&path)).unwrap();
    let lost = transfer.run(&TransferProgress::default()).await.unwrap_err();
    assert!(lost.is_missing_file() && lost.to_string().contains(&path), "{lost}");

    let transfer = places.prepare_backup(&from, &to).await;
    for table in ["checkpoint_file WHERE checkpoint", "checkpoint WHERE id"] {
        let delete = format!("DELETE FROM {table} = {id}");
        sqlx::query(AssertSqlSafe(delete)).execute(&mut connection).await.unwrap();
    }
    transfer.run(&TransferProgress::default()).await.unwrap();
    let mut connection = sqlite(places.last.path()).await;
    let left: Vec<i64> = sqlx::query_scalar("SELECT id FROM checkpoint ORDER BY id")
        .fetch_all(&mut connection)
        .await
        .unwrap();
    assert!(!left.is_empty() && !left.contains(&id), "{id} among {left:?}");
}
