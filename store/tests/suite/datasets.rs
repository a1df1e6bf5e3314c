use std::collections::BTreeMap;

use serde_json::json;
use spec::Digest;
use store::{
    ChannelSummary, DatasetState, FileContent, ItemKind, JobState, NewJob, Page, Retry, Reuse,
    ShardContents, ShardSummary, StoredObject, Submission,
};

use super::labels::naming;
use super::{Fixture, assert_lost, digest_of, simulate};

pub async fn the_last_shard_completes_dataset_and_job(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let id = f.store.job(job).await.unwrap().dataset.unwrap();
    for left in (0..3).rev() {
        assert!(f.store.dataset_by_digest(digest_of(&simulate(1))).await.unwrap().is_none());
        let task = f.must_claim().await;
        let shard = f.publish_shard(&task).await;
        f.store.commit_shard(task.fence, &shard, Some(&json!({"left": left}))).await.unwrap();
    }
    let dataset = f.store.dataset_by_digest(digest_of(&simulate(1))).await.unwrap().unwrap();
    assert_eq!((dataset.id, dataset.job, dataset.state), (id, job, DatasetState::Complete));
    assert_eq!((dataset.trajectories, dataset.samples, dataset.shards), (6, 4, 3));
    assert_eq!((dataset.rejected, dataset.bytes), (3, 3 * ("trajectories 0robots 0".len() as u64)));
    assert_eq!(f.state(job).await, JobState::Succeeded);

    let shards = f.store.shards(id).await.unwrap();
    let ranges: Vec<_> =
        shards.iter().map(|s| (s.ordinal, s.contents.first, s.contents.count)).collect();
    assert_eq!(ranges, [(0, 0, 2), (1, 2, 2), (2, 4, 2)]);
    assert_eq!(FileContent::Robots.file_name(shards[1].ordinal), "robots-00001.parquet");
    assert_eq!(shards[1].contents.file(FileContent::Robots).sha256, Digest::of(b"robots 1"));
    assert_eq!(f.store.datasets(None, Page::default()).await.unwrap().len(), 1);
    let building = f.store.datasets(Some(DatasetState::Building), Page::default()).await.unwrap();
    assert!(building.is_empty());
}

pub async fn a_digest_has_the_name_of_the_newest_result(f: Fixture) {
    let first = f.submit_one(simulate(1)).await;
    f.submit_one(NewJob { name: "other".to_owned(), ..simulate(2) }).await;
    let [one, two, none] = [1, 2, 3].map(|seed| digest_of(&simulate(seed)));
    let names = async || {
        let found = f.store.names_of_digests(&[one, two, none]).await.unwrap();
        found.into_iter().collect::<BTreeMap<Digest, String>>()
    };
    let named = |name: &str| BTreeMap::from([(one, name.to_owned()), (two, "other".to_owned())]);
    assert_eq!(names().await, named("train-set"));
    let dataset = f.store.job(first).await.unwrap().dataset.unwrap();
    f.store.change_labels(ItemKind::Dataset, dataset.0, &naming("arms")).await.unwrap();
    assert_eq!(names().await, named("arms"));
    let forced = Submission { reuse: Reuse::Never, ..Submission::of(simulate(1)) };
    f.submit(forced).await;
    assert_eq!(names().await, named("train-set"));
    assert!(f.store.names_of_digests(&[]).await.unwrap().is_empty());
}

pub async fn a_shard_committed_twice_is_there_once(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let task = f.must_claim().await;
    let shard = f.publish_shard(&task).await;
    f.store.commit_shard(task.fence, &shard, None).await.unwrap();
    f.store.commit_shard(task.fence, &shard, None).await.unwrap();
    let id = f.store.job(job).await.unwrap().dataset.unwrap();
    assert_eq!(f.store.shards(id).await.unwrap().len(), 1);
}

pub async fn a_dataset_without_all_its_trajectories_is_not_complete(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    f.work_off().await;
    let id = f.store.job(job).await.unwrap().dataset.unwrap();
    assert_eq!(f.store.dataset(id).await.unwrap().state, DatasetState::Building);
}

pub async fn a_zombie_neither_commits_nor_overwrites_a_shard(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let dead = f.claim_and_die().await;
    let late = f.publish_shard(&dead).await;
    f.reap().await;
    let mut alive = f.must_claim().await;
    while alive.fence.task != dead.fence.task {
        alive = f.must_claim().await;
    }
    let shard = f.publish_shard(&alive).await;
    f.store.commit_shard(alive.fence, &shard, None).await.unwrap();
    assert_lost(f.store.commit_shard(dead.fence, &late, None).await, dead.fence);
    let id = f.store.job(job).await.unwrap().dataset.unwrap();
    let shards = f.store.shards(id).await.unwrap();
    assert_eq!(shards.len(), 1);
    assert_eq!(shards[0].contents.trajectories, shard.trajectories);
    assert_ne!(shards[0].contents.trajectories.path, late.trajectories.path);
}

pub async fn a_row_never_comes_before_its_bytes(f: Fixture) {
    f.submit_one(simulate(1)).await;
    let task = f.must_claim().await;
    let published = f.publish_shard(&task).await;
    let absent = StoredObject { path: "datasets/1/absent".into(), ..published.robots.clone() };
    let short = StoredObject { size: 3, ..published.robots.clone() };
    for robots in [absent, short] {
        let shard = ShardContents { robots, ..published.clone() };
        let error = f.store.commit_shard(task.fence, &shard, None).await.unwrap_err();
        assert!(error.object_path().is_some(), "{error}");
    }
    assert_eq!(f.state(task.job).await, JobState::Running);
}

pub async fn what_shards_hold_adds_up_over_their_dataset(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let id = f.store.job(job).await.unwrap().dataset.unwrap();
    assert_eq!(f.store.dataset_summary(id).await.unwrap(), None);
    for (min, max, mean) in [(-1.0, 1.0, 0.25), (-3.0, 0.5, -0.25)] {
        let task = f.must_claim().await;
        let shard = f.publish_shard(&task).await;
        let q1 = ChannelSummary { name: "q1".to_owned(), min, max, mean, std: 0.5 };
        let summary = ShardSummary {
            trajectories: 2,
            samples: 8,
            rejected: 1,
            channels: vec![q1],
            spectra: Vec::new(),
            arms: Vec::new(),
        };
        f.store.commit_shard(task.fence, &shard, Some(&summary.to_result())).await.unwrap();
    }
    // The record of another version is ignored and breaks nothing.
    let task = f.must_claim().await;
    let shard = f.publish_shard(&task).await;
    f.store.commit_shard(task.fence, &shard, Some(&json!({"rows": 3}))).await.unwrap();
    let summary = f.store.dataset_summary(id).await.unwrap().unwrap();
    assert_eq!((summary.trajectories, summary.samples, summary.rejected), (4, 16, 2));
    let q1 = &summary.channels[0];
    assert_eq!((q1.min, q1.max, q1.mean), (-3.0, 1.0, 0.0));
    assert!((q1.std - (0.5f64.powi(2) + 0.25f64.powi(2)).sqrt()).abs() < 1e-12, "{q1:?}");
}

pub async fn the_dataset_of_a_job_that_failed_is_abandoned(f: Fixture) {
    let failed = f.submit_one(simulate(1)).await;
    f.submit_one(simulate(2)).await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, "bad data", Retry::Never).await.unwrap();
    let id = f.store.job(failed).await.unwrap().dataset.unwrap();
    assert_eq!(f.store.dataset(id).await.unwrap().state, DatasetState::Abandoned);
    let listed = async |state| {
        let datasets = f.store.datasets(Some(state), Page::default()).await.unwrap();
        datasets.iter().map(|dataset| dataset.id).collect::<Vec<_>>()
    };
    assert_eq!(listed(DatasetState::Abandoned).await, [id]);
    let building = listed(DatasetState::Building).await;
    assert!(building.len() == 1 && building != [id]);
}
