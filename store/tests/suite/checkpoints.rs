use bytes::Bytes;
use store::{CheckpointFile, CheckpointId, ClaimedTask, NewCheckpoint, Page, object_path};

use super::{Fixture, digest_of, simulate, train};

async fn commit(f: &Fixture, task: &ClaimedTask, step: u64, is_final: bool) -> CheckpointId {
    let mut files = Vec::new();
    for name in ["model.safetensors", "config.json"] {
        let path = object_path::checkpoint(task.job, step, task.fence.epoch, name);
        let bytes = Bytes::from(format!("{name} {step}"));
        let object = f.store.put_object(&path, bytes).await.unwrap();
        files.push(CheckpointFile { name: name.into(), object });
    }
    let new = NewCheckpoint { step, is_final, files };
    f.store.commit_checkpoint(task.fence, &new).await.unwrap()
}

pub async fn a_training_resumes_from_its_latest_checkpoint(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    assert!(f.store.latest_checkpoint(job).await.unwrap().is_none());
    let task = f.claim_and_die().await;
    commit(&f, &task, 200, false).await;
    let id = commit(&f, &task, 400, false).await;
    f.store.reap().await.unwrap();
    let task = f.must_claim().await;
    let latest = f.store.latest_checkpoint(task.job).await.unwrap().unwrap();
    assert_eq!((latest.id, latest.step, latest.is_final), (id, 400, false));
    let model = f.store.read_object(latest.file("model.safetensors").unwrap()).await.unwrap();
    assert_eq!(model, "model.safetensors 400");
    assert!(latest.file("absent").is_none());
    let digest = digest_of(&train(&simulate(1), vec![]));
    assert!(f.store.final_checkpoint_by_digest(digest).await.unwrap().is_none());
}

pub async fn the_final_checkpoint_is_found_by_digest(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    commit(&f, &task, 400, false).await;
    let id = commit(&f, &task, 600, true).await;
    let digest = digest_of(&train(&simulate(1), vec![]));
    let found = f.store.final_checkpoint_by_digest(digest).await.unwrap().unwrap();
    assert_eq!((found.id, found.digest, found.run), (id, digest, task.run.unwrap()));
    let other = digest_of(&simulate(1));
    assert!(f.store.final_checkpoint_by_digest(other).await.unwrap().is_none());
}

pub async fn a_step_that_is_taken_again_keeps_its_checkpoints_id(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let dead = f.claim_and_die().await;
    let first = commit(&f, &dead, 200, false).await;
    let old = f.store.checkpoint(first).await.unwrap();
    f.store.reap().await.unwrap();
    let task = f.must_claim().await;
    assert_eq!(commit(&f, &task, 200, true).await, first);
    let new = f.store.checkpoint(first).await.unwrap();
    assert!(new.is_final);
    assert_eq!(new.files.len(), 2);
    f.store.read_object(&new.files[0].object).await.unwrap();
    assert!(f.store.read_object(&old.files[0].object).await.is_err(), "replaced bytes are gone");
    // Once more under the same lease: the same paths, which must survive.
    commit(&f, &task, 200, true).await;
    f.store.read_object(&new.files[0].object).await.unwrap();
}

pub async fn old_checkpoints_are_pruned_with_their_bytes(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    commit(&f, &task, 100, true).await;
    let mut ids = Vec::new();
    for step in [200, 300, 400, 500] {
        ids.push(commit(&f, &task, step, false).await);
    }
    let pruned = f.store.checkpoint(ids[0]).await.unwrap();
    f.store.prune_checkpoints(task.fence, 2).await.unwrap();
    let left = f.store.checkpoints_of_job(job).await.unwrap();
    assert_eq!(left.iter().map(|c| c.step).collect::<Vec<_>>(), [100, 400, 500]);
    assert!(f.store.checkpoint(ids[0]).await.is_err());
    assert!(f.store.read_object(&pruned.files[0].object).await.is_err());
    for checkpoint in f.store.checkpoints(Page::default()).await.unwrap() {
        f.store.read_object(&checkpoint.files[0].object).await.unwrap();
    }
}
