use std::collections::BTreeMap;

use bytes::Bytes;
use store::{
    CheckpointFile, CheckpointId, ClaimedTask, NewCheckpoint, Page, WhichCheckpoint, object_path,
};

use super::{Fixture, digest_of, simulate, train};

pub async fn commit(f: &Fixture, task: &ClaimedTask, step: u64, is_final: bool) -> CheckpointId {
    commit_as(f, task, NewCheckpoint { is_final, ..unmarked(step) }).await
}

pub async fn commit_measured(
    f: &Fixture,
    task: &ClaimedTask,
    metrics: BTreeMap<String, f64>,
) -> CheckpointId {
    commit_as(f, task, NewCheckpoint { metrics, ..unmarked(100) }).await
}

fn unmarked(step: u64) -> NewCheckpoint {
    let (metrics, files) = (BTreeMap::new(), Vec::new());
    NewCheckpoint { step, is_final: false, is_best: false, metrics, files }
}

async fn commit_as(f: &Fixture, task: &ClaimedTask, new: NewCheckpoint) -> CheckpointId {
    let step = new.step;
    let mut files = Vec::new();
    for name in ["model.safetensors", "config.json"] {
        let path = object_path::checkpoint(task.job, step, task.fence.epoch, name);
        let bytes = Bytes::from(format!("{name} {step}"));
        let object = f.store.put_object(&path, bytes).await.unwrap();
        files.push(CheckpointFile { name: name.into(), object });
    }
    let new = NewCheckpoint { files, ..new };
    f.store.commit_checkpoint(task.fence, &new).await.unwrap()
}

pub async fn a_training_resumes_from_its_latest_checkpoint(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    assert!(f.store.latest_checkpoint(job).await.unwrap().is_none());
    let task = f.claim_and_die().await;
    commit(&f, &task, 200, false).await;
    let id = commit(&f, &task, 400, false).await;
    f.reap().await;
    let task = f.must_claim().await;
    let latest = f.store.latest_checkpoint(task.job).await.unwrap().unwrap();
    assert_eq!((latest.id, latest.step, latest.is_final), (id, 400, false));
    let model = f.store.read_object(latest.file("model.safetensors").unwrap()).await.unwrap();
    assert_eq!(model, "model.safetensors 400");
    assert!(latest.file("absent").is_none());
    let digest = digest_of(&train(&simulate(1), vec![]));
    assert!(f.store.checkpoint_by_digest(digest, WhichCheckpoint::Final).await.unwrap().is_none());
}

pub async fn the_final_checkpoint_is_found_by_digest(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    commit(&f, &task, 400, false).await;
    let id = commit(&f, &task, 600, true).await;
    let digest = digest_of(&train(&simulate(1), vec![]));
    let found =
        f.store.checkpoint_by_digest(digest, WhichCheckpoint::Final).await.unwrap().unwrap();
    assert_eq!((found.id, found.digest, found.run), (id, digest, task.run.unwrap()));
    let other = digest_of(&simulate(1));
    assert!(f.store.checkpoint_by_digest(other, WhichCheckpoint::Final).await.unwrap().is_none());
}

pub async fn a_step_that_is_taken_again_keeps_its_checkpoints_id(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let dead = f.claim_and_die().await;
    let first = commit(&f, &dead, 200, false).await;
    let old = f.store.checkpoint(first).await.unwrap();
    f.reap().await;
    let task = f.must_claim().await;
    assert_eq!(commit(&f, &task, 200, true).await, first);
    let new = f.store.checkpoint(first).await.unwrap();
    assert!(new.is_final);
    assert_eq!(new.files.len(), 2);
    f.store.read_object(&new.files[0].object).await.unwrap();
    assert!(f.store.read_object(&old.files[0].object).await.is_err(), "replaced bytes are gone");
    // Commits again under the same lease. The paths are the same and must survive.
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

pub async fn a_pruned_checkpoint_leaves_no_empty_folder(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    for step in [100, 200, 300] {
        commit(&f, &task, step, false).await;
    }
    f.store.prune_checkpoints(task.fence, 1).await.unwrap();
    let folder = f.dir.path().join(format!("objects/checkpoints/{job}"));
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), 1);
}

pub async fn a_checkpoint_that_nobody_can_use_is_discarded(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    commit(&f, &task, 100, false).await;
    let id = commit(&f, &task, 200, false).await;
    let damaged = f.store.checkpoint(id).await.unwrap();
    f.store.discard_checkpoint(task.fence, id).await.unwrap();
    assert_eq!(f.store.latest_checkpoint(job).await.unwrap().unwrap().step, 100);
    assert!(f.store.read_object(&damaged.files[0].object).await.is_err());
    let again = commit(&f, &task, 200, false).await;
    assert_eq!(f.store.latest_checkpoint(job).await.unwrap().unwrap().id, again);
}

pub async fn one_checkpoint_of_a_training_is_the_best_and_one_the_last(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let marks = async || -> Vec<(u64, bool, bool)> {
        let all = f.store.checkpoints_of_job(job).await.unwrap();
        all.iter().map(|found| (found.step, found.is_best, found.is_last)).collect()
    };
    for (step, rmse) in [(100, 2.5), (200, 1.25)] {
        let metrics = BTreeMap::from([("validation/rmse_deg".to_owned(), rmse)]);
        let new = NewCheckpoint { is_best: true, metrics, ..unmarked(step) };
        commit_as(&f, &task, new).await;
    }
    commit(&f, &task, 300, false).await;
    let expected = [(100, false, false), (200, true, false), (300, false, true)];
    assert_eq!(marks().await, expected);

    // Commits the best step again, as at the end of a training. It stays the best.
    let digest = digest_of(&train(&simulate(1), vec![]));
    let which = WhichCheckpoint::Step(200);
    let best = f.store.checkpoint_by_digest(digest, which).await.unwrap().unwrap();
    assert_eq!(best.metrics, BTreeMap::from([("validation/rmse_deg".to_owned(), 1.25)]));
    commit(&f, &task, 200, false).await;
    assert_eq!(marks().await, expected);

    let with_weights =
        |sha256| f.store.checkpoint_by_digest(digest, WhichCheckpoint::Weights(sha256));
    for of_step in [100, 200] {
        let which = WhichCheckpoint::Step(of_step);
        let found = f.store.checkpoint_by_digest(digest, which).await.unwrap().unwrap();
        let sha256 = found.file("model.safetensors").unwrap().sha256;
        assert_eq!(with_weights(sha256).await.unwrap().unwrap().id, found.id);
    }
    assert!(with_weights(digest).await.unwrap().is_none(), "no file has the digest of a spec");

    let best = WhichCheckpoint::Best;
    let unfinished = f.store.checkpoint_by_digest(digest, best).await.unwrap();
    assert!(unfinished.is_none(), "another may yet be better");
    f.store.complete(task.fence, None).await.unwrap();
    assert_eq!(f.store.checkpoint_by_digest(digest, best).await.unwrap().unwrap().step, 200);
}

pub async fn the_best_checkpoint_is_never_pruned(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    commit_as(&f, &task, NewCheckpoint { is_best: true, ..unmarked(100) }).await;
    for step in [200, 300, 400] {
        commit(&f, &task, step, false).await;
        f.store.prune_checkpoints(task.fence, 1).await.unwrap();
    }
    let left = f.store.checkpoints_of_job(job).await.unwrap();
    assert_eq!(left.iter().map(|found| found.step).collect::<Vec<_>>(), [100, 400]);
    for checkpoint in left {
        f.store.read_object(&checkpoint.files[0].object).await.unwrap();
    }
}
