//! Moves that stop in the middle, and continue when they are repeated.

use std::path::Path;

use store::{Access, Location, Store, StoreError, TransferProgress};
use testbed::Cluster;

use super::Places;
use crate::s3_server::{Asked, Fault};
use crate::suite::{alone, simulate};

impl Places {
    /// Runs a move until `reached`, and drops it.
    async fn give_up(
        &self,
        from: &Location,
        to: &Location,
        reached: impl Fn(&TransferProgress) -> bool,
    ) {
        let (transfer, progress) =
            (self.prepare(from, to).await.unwrap(), TransferProgress::default());
        let when_reached = async {
            while !reached(&progress) {
                tokio::task::yield_now().await;
            }
        };
        tokio::select! {
            biased;
            () = when_reached => {}
            ended = transfer.run(&progress) => panic!("{ended:?} before it was given up"),
        }
    }

    /// Checks that neither servers nor workers open it.
    async fn assert_unfinished(&self, place: &Location) {
        for access in [Access::Server, Access::Worker] {
            let error = self.open(place, access).await.unwrap_err();
            assert!(matches!(error, StoreError::UnfinishedTransfer { .. }), "{error}");
            assert!(error.to_string().contains("repeat `torqued migrate`"), "{error}");
        }
    }

    fn jobs_in_postgres(&self) -> String {
        Cluster::shared().psql(self.database.name(), "SELECT count(*) FROM job")
    }
}

/// An object with more bytes than one piece.
fn checkpoint(objects: &[(String, Vec<u8>)]) -> &(String, Vec<u8>) {
    let is_large = |(path, bytes): &&(String, Vec<u8>)| {
        path.starts_with("checkpoints/") && bytes.len() > 600_000
    };
    objects.iter().find(is_large).unwrap()
}

fn damage(file: &Path, bytes: &[u8]) {
    let mut damaged = bytes.to_vec();
    damaged[0] ^= 1;
    std::fs::write(file, damaged).unwrap();
}

fn assert_damaged(error: &StoreError, path: &str) {
    let is_damaged =
        matches!(error, StoreError::DamagedObject { path: named, .. } if named == path);
    assert!(is_damaged && error.to_string().contains(path), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_damaged_object_stops_the_move_which_is_repeated_when_it_is_whole_again() {
    let places = Places::filled().await;
    let (from, to) = (places.first(), places.postgres());
    let all = places.objects(&from);
    let (path, bytes) = checkpoint(&all);
    let file = places.first.path().join("objects").join(path);
    damage(&file, bytes);
    assert_damaged(&places.transfer(&from, &to).await.unwrap_err(), path);
    places.assert_unfinished(&to).await;
    assert_eq!(places.jobs_in_postgres(), "0");
    // Another file under the path of an object makes no difference.
    let (other, _) = all.iter().find(|(path, _)| path.starts_with("runs/")).unwrap();
    let half = to.folder.join("objects").join(other);
    std::fs::create_dir_all(half.parent().unwrap()).unwrap();
    std::fs::write(half, "half").unwrap();
    std::fs::write(&file, bytes).unwrap();
    places.transfer(&from, &to).await.unwrap();
    assert!(places.objects(&to) == all);
    places.open(&to, Access::Server).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_damaged_object_of_a_bucket_stops_the_move_as_well() {
    let places = Places::filled().await;
    let (from, to) = (places.postgres_and_s3(), places.last());
    places.transfer(&places.first(), &from).await.unwrap();
    let all = places.objects(&from);
    let (path, bytes) = checkpoint(&all);
    damage(&places.bucket.file(&format!("arm/{path}")), bytes);
    assert_damaged(&places.transfer(&from, &to).await.unwrap_err(), path);
    places.assert_unfinished(&to).await;
    std::fs::remove_file(places.bucket.file(&format!("arm/{path}"))).unwrap();
    let error = places.transfer(&from, &to).await.unwrap_err();
    assert!(error.is_missing_file() && error.to_string().contains(path), "{error}");
    std::fs::write(places.bucket.file(&format!("arm/{path}")), bytes).unwrap();
    places.transfer(&from, &to).await.unwrap();
    assert!(places.objects(&to) == all);
}

#[tokio::test(flavor = "multi_thread")]
async fn objects_that_were_copied_before_are_compared_and_not_copied_again() {
    let places = Places::filled().await;
    let (from, to) = (places.first(), places.postgres_and_s3());
    let all = places.objects(&from);
    places.give_up(&from, &to, |progress| progress.bytes() > 2_000_000).await;
    places.assert_unfinished(&to).await;
    assert_eq!(places.jobs_in_postgres(), "0");

    let before = places.bucket.count(Asked::Put);
    let progress = TransferProgress::default();
    places.prepare(&from, &to).await.unwrap().run(&progress).await.unwrap();
    let found = usize::try_from(progress.found()).unwrap();
    assert!(found > 0 && found < all.len(), "{found} of {}", all.len());
    // Objects that existed were not sent. The count includes probes and the mark.
    let sent = places.bucket.count(Asked::Put) - before;
    assert!(sent < all.len(), "{sent} sent of {}, {found} found", all.len());
    assert!(places.objects(&to) == all);
    places.open(&to, Access::Server).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bucket_that_fails_leaves_an_unfinished_place() {
    let places = Places::filled().await;
    let (from, to) = (places.first(), places.postgres_and_s3());
    let transfer = places.prepare(&from, &to).await.unwrap();
    // A refusal after a lost answer would be settled by reading the object back. So no answer is
    // lost here.
    places.bucket.fail(Asked::Put, [Fault::Busy, Fault::Denied]);
    let error = transfer.run(&TransferProgress::default()).await.unwrap_err();
    assert!(error.object_path().is_some(), "{error}");
    places.assert_unfinished(&to).await;
    places.transfer(&from, &to).await.unwrap();
    assert!(places.objects(&to) == places.objects(&from));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_move_that_is_given_up_between_rows_leaves_none() {
    let places = Places::filled().await;
    let (from, to) = (places.first(), places.postgres());
    places.give_up(&from, &to, |progress| progress.rows() > 0).await;
    assert_eq!(places.jobs_in_postgres(), "0");
    places.assert_unfinished(&to).await;
    places.transfer(&from, &to).await.unwrap();
    assert_ne!(places.jobs_in_postgres(), "0");
}

/// The program may stop between the commit of the rows and the removal of the mark.
#[tokio::test(flavor = "multi_thread")]
async fn rows_that_are_there_already_are_compared() {
    let places = Places::filled().await;
    let (from, to) = (places.first(), places.postgres());
    places.transfer(&from, &to).await.unwrap();
    let source = Store::open_at(&from, Access::Server).await.unwrap();
    let mark = serde_json::json!({"from": source.identity().await.unwrap()}).to_string();
    source.close().await;
    drop(source);
    let unfinished = to.folder.join("objects/unfinished-move.json");
    std::fs::write(&unfinished, &mark).unwrap();
    places.assert_unfinished(&to).await;
    places.transfer(&from, &to).await.unwrap();
    assert!(!unfinished.exists());

    std::fs::write(&unfinished, &mark).unwrap();
    let source = Store::open_at(&from, Access::Server).await.unwrap();
    source.submit(alone(simulate(99))).await.unwrap();
    source.close().await;
    drop(source);
    let error = places.transfer(&from, &to).await.unwrap_err();
    assert!(matches!(error, StoreError::RowsDiffer { table: "job", .. }), "{error}");
}
