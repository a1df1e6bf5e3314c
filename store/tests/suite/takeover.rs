use std::collections::BTreeMap;

use bytes::Bytes;
use store::{
    CheckpointFile, ClaimedTask, Metric, NewCheckpoint, Retry, Reuse, Submission, object_path,
};

use super::{Fixture, alone, simulate, train};

/// Publishes and commits a checkpoint of a claimed training.
async fn keep(f: &Fixture, task: &ClaimedTask, step: u64, is_best: bool) {
    let path = object_path::checkpoint(task.job, step, task.fence.epoch, "model");
    let object = f.store.put_object(&path, Bytes::from(format!("step {step}"))).await.unwrap();
    let files = vec![CheckpointFile { name: "model".into(), object }];
    let metrics = BTreeMap::new();
    let new = NewCheckpoint { step, is_final: false, is_best, metrics, files };
    f.store.commit_checkpoint(task.fence, &new).await.unwrap();
}

pub async fn shards_of_a_job_that_failed_are_there_for_the_next(f: Fixture) {
    let failed = f.submit_one(simulate(1)).await;
    let first = f.must_claim().await;
    let shard = f.publish_shard(&first).await;
    let result = serde_json::json!({"rows": 8});
    f.store.commit_shard(first.fence, &shard, Some(&result)).await.unwrap();
    let second = f.must_claim().await;
    f.store.fail(second.fence, "out of luck", Retry::Never).await.unwrap();
    assert!(f.store.earlier_shard(failed, 0).await.unwrap().is_none(), "it has its own");

    let next = f.submit_one(simulate(1)).await;
    assert_ne!(next, failed);
    let task = f.must_claim().await;
    let earlier = f.store.earlier_shard(next, 0).await.unwrap().unwrap();
    assert_eq!(earlier.result, Some(result));
    assert_eq!(earlier.contents.trajectories, shard.trajectories);
    assert!(f.store.earlier_shard(next, 1).await.unwrap().is_none(), "nobody made it");

    let copied = f.store.copy_object(&shard.robots, "datasets/2/copy").await.unwrap();
    assert_eq!((copied.sha256, copied.size), (shard.robots.sha256, shard.robots.size));
    let (bytes, same) = (f.store.read_object(&copied), f.store.read_object(&shard.robots));
    assert_eq!(bytes.await.unwrap(), same.await.unwrap());
    f.store.release(task.fence).await.unwrap();
}

pub async fn a_training_goes_on_where_one_that_failed_ended(f: Fixture) {
    let failed = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    for step in [2, 4, 6] {
        let metric = Metric { key: "train/loss".into(), step, value: 1.0 };
        f.store.record_metrics(task.fence, &[metric]).await.unwrap();
        keep(&f, &task, step, step == 4).await;
    }
    assert!(f.store.earlier_checkpoints(failed).await.unwrap().is_empty(), "it has its own");
    f.store.fail(task.fence, "out of luck", Retry::Never).await.unwrap();

    let next = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let earlier = f.store.earlier_checkpoints(next).await.unwrap();
    let steps: Vec<_> =
        earlier.iter().map(|checkpoint| (checkpoint.step, checkpoint.is_best)).collect();
    assert_eq!(steps, [(2, false), (4, true), (6, false)]);
    f.store.take_over_metrics(task.fence, earlier[1].run, 4).await.unwrap();
    let run = task.run.unwrap();
    let curve = f.store.metric_curve(run, "train/loss", 100).await.unwrap();
    assert_eq!(curve.points.iter().map(|point| point.step).collect::<Vec<_>>(), [2, 4]);
    f.store.release(task.fence).await.unwrap();
}

pub async fn a_job_that_is_to_be_done_anew_takes_nothing_over(f: Fixture) {
    let failed = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    keep(&f, &task, 2, false).await;
    f.store.fail(task.fence, "out of luck", Retry::Never).await.unwrap();
    let anew = Submission { reuse: Reuse::Never, ..alone(train(&simulate(1), vec![])) };
    let job = f.submit(anew).await.job;
    assert_ne!(job, failed);
    assert!(f.store.earlier_checkpoints(job).await.unwrap().is_empty());
}
