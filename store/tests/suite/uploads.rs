use std::time::Duration;

use object_store::ObjectStoreExt;
use spec::Digest;
use store::{DatasetState, JobState, ShardContents, Upload};

use super::{Fixture, alone, assert_lost, import};

async fn send(f: &Fixture, name: &str, pieces: &[&[u8]]) -> Upload {
    let mut writer = f.store.begin_upload().await.unwrap();
    for piece in pieces {
        writer.write(piece).await.unwrap();
    }
    writer.finish(name).await.unwrap()
}

pub async fn a_file_is_found_by_its_digest(f: Fixture) {
    let piece = vec![b'x'; 3_000_000];
    let sent = send(&f, "arm.csv", &[b"u1,", &piece, &piece, &piece, &piece, b"!"]).await;
    let whole = [&b"u1,"[..], &piece, &piece, &piece, &piece, b"!"].concat();
    assert_eq!((sent.object.size, sent.object.sha256), (12_000_004, Digest::of(&whole)));
    let found = f.store.upload(Digest::of(&whole)).await.unwrap().unwrap();
    assert_eq!((found.name.as_str(), found.object), ("arm.csv", sent.object.clone()));
    assert_eq!(f.store.read_object(&sent.object).await.unwrap(), whole);
    assert!(f.store.upload(Digest::of(b"other")).await.unwrap().is_none());
    assert_eq!(f.store.newest_uploads(10).await.unwrap().len(), 1);
}

pub async fn a_file_that_is_sent_again_is_kept_once(f: Fixture) {
    let first = send(&f, "first", &[b"same"]).await;
    let again = send(&f, "again", &[b"sa", b"me"]).await;
    assert_eq!((again.name.as_str(), &again.object.path), ("first", &first.object.path));
    tokio::time::sleep(Duration::from_millis(5)).await;
    assert_eq!(f.sweep(Duration::ZERO).await, 0, "only one was kept");
}

pub async fn a_file_that_was_lost_can_be_sent_again(f: Fixture) {
    let lost = send(&f, "first", &[b"same"]).await;
    f.objects.delete(&lost.object.path.as_str().into()).await.unwrap();
    let again = send(&f, "again", &[b"same"]).await;
    assert_ne!(again.object.path, lost.object.path);
    let found = f.store.upload(lost.object.sha256).await.unwrap().unwrap();
    assert_eq!(found.object, again.object);
    assert!(f.store.open_upload(&found).is_ok());
}

pub async fn a_file_that_breaks_off_leaves_nothing(f: Fixture) {
    let kept = send(&f, "kept", &[b"kept"]).await;
    let mut writer = f.store.begin_upload().await.unwrap();
    writer.write(&vec![b'x'; 20_000_000]).await.unwrap();
    drop(writer);
    let files = || {
        let entries = std::fs::read_dir(f.dir.path().join("objects/uploads")).unwrap();
        entries.map(|entry| entry.unwrap().file_name()).collect::<Vec<_>>()
    };
    // A separate thread deletes the written bytes.
    for _ in 0..200 {
        if files().len() == 1 {
            break;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    assert_eq!(files().len(), 1);
    assert_eq!(f.store.newest_uploads(10).await.unwrap().len(), 1);
    assert!(f.store.read_object(&kept.object).await.is_ok());
}

pub async fn a_file_is_no_orphan_and_what_was_not_committed_is(f: Fixture) {
    let kept = send(&f, "kept", &[b"kept"]).await;
    f.store.put_object("uploads/upload-1-2-3", "lost".into()).await.unwrap();
    // Some stores round times to seconds.
    tokio::time::sleep(Duration::from_millis(1100)).await;
    assert_eq!(f.sweep(Duration::ZERO).await, 1);
    assert!(f.store.open_upload(&kept).is_ok());
}

pub async fn a_changed_file_is_not_opened(f: Fixture) {
    let sent = send(&f, "arm.csv", &[b"right"]).await;
    f.damage(&sent.object.path, "wrong".into()).await;
    let error = f.store.open_upload(&sent).unwrap_err();
    assert!(error.to_string().contains(&sent.object.path), "{error}");
}

pub async fn an_import_tells_how_many_trajectories_there_are(f: Fixture) {
    let file = send(&f, "arm.csv", &[b"file"]).await;
    let job = f.submit(alone(import(file.object.sha256))).await.job;
    let id = f.store.job(job).await.unwrap().dataset.unwrap();
    assert_eq!(f.store.dataset(id).await.unwrap().trajectories, 0);

    let dead = f.claim_and_die().await;
    let late = f.publish_shard(&dead).await;
    f.reap().await;
    let claimed = f.must_claim().await;
    let shard =
        ShardContents { first: 0, count: 7, rejected: 0, ..f.publish_shard(&claimed).await };
    let result = serde_json::json!({"rows": 30});
    assert_lost(f.store.commit_import(dead.fence, &late, &result).await, dead.fence);
    assert_eq!(f.store.dataset(id).await.unwrap().trajectories, 0);

    f.store.commit_import(claimed.fence, &shard, &result).await.unwrap();
    f.store.commit_import(claimed.fence, &shard, &result).await.unwrap();
    let dataset = f.store.dataset(id).await.unwrap();
    assert_eq!((dataset.state, dataset.trajectories), (DatasetState::Complete, 7));
    let job = f.store.job(job).await.unwrap();
    assert_eq!((job.state, job.progress.done, job.progress.total), (JobState::Succeeded, 7, 7));
}
