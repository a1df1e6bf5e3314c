//! Retention: what goes into the trash by itself, and logs that grow old.

use std::time::Duration;

use serde_json::json;
use spec::Digest;
use store::{Item, JobState, Need, Retry};

use super::trash::{checkpoint, finished, is_there, work};
use super::{Fixture, LONG, evaluate, pipeline, simulate, train};

pub async fn jobs_that_failed_go_by_themselves_when_nothing_depends_on_them(f: Fixture) {
    finished(&f, 1).await;
    let lonely = f.submit_one(simulate(2)).await;
    f.store.cancel(lonely).await.unwrap();
    // Its checkpoint was evaluated.
    let data = simulate(1);
    let simulated = f.submit_one(data.clone()).await;
    let training = store::NewJob { spec: json!({"other": 1}), ..train(&data, vec![]) };
    let training = store::NewJob { digest: Digest::of_json(&training.spec), ..training };
    let trained = f.submit_one(training.clone()).await;
    let task = f.must_claim().await;
    checkpoint(&f, &task, 5, false).await;
    f.store.fail(task.fence, "too hot", Retry::Never).await.unwrap();
    let needs = vec![Need::Existing(simulated)];
    f.submit_one(evaluate(&data, &training, needs)).await;
    work(&f).await;
    // A member of this pipeline succeeded.
    let partly = f.submit(pipeline(3)).await.job;
    for _ in 0..3 {
        let task = f.must_claim().await;
        let shard = f.publish_shard(&task).await;
        f.store.commit_shard(task.fence, &shard, None).await.unwrap();
    }
    f.store.cancel(partly).await.unwrap();
    let retention =
        |age| store::Retention { failed_jobs: Some(age), ..store::Retention::default() };
    assert_eq!(f.store.outdated(store::Retention::default()).await.unwrap(), []);
    assert_eq!(f.store.outdated(retention(LONG)).await.unwrap(), []);
    tokio::time::sleep(Duration::from_millis(5)).await;
    let foretold = f.store.outdated(retention(Duration::ZERO)).await.unwrap();
    assert_eq!(foretold.iter().map(|outdated| outdated.item).collect::<Vec<_>>(), [lonely.into()]);
    let retired = f.store.retire(retention(Duration::ZERO), LONG).await.unwrap();
    assert_eq!(retired, foretold);
    let trash = f.store.trash(None, 10).await.unwrap();
    assert_eq!(trash[0].deletion.reason.as_deref(), Some("failed jobs are kept for 0 days"));
    assert!(is_there(&f.store, trained.into()).await && is_there(&f.store, partly.into()).await);
    assert_eq!(f.store.outdated(retention(Duration::ZERO)).await.unwrap(), []);
}

pub async fn old_checkpoints_go_unless_somebody_uses_them(f: Fixture) {
    let data = simulate(1);
    f.submit_one(data.clone()).await;
    work(&f).await;
    let training = train(&data, vec![]);
    let trained = f.submit_one(training.clone()).await;
    let task = f.must_claim().await;
    for step in [10, 20, 30, 40, 50, 60, 70] {
        checkpoint(&f, &task, step, step == 70).await;
    }
    let keep =
        |newest| store::Retention { checkpoints: Some(newest), ..store::Retention::default() };
    assert_eq!(f.store.outdated(keep(1)).await.unwrap(), [], "the training goes on");
    f.store.complete(task.fence, None).await.unwrap();
    let spec = json!({"checkpoint": {"step": {"digest": training.digest, "step": 20}}});
    let digest = Digest::of_json(&spec);
    let reader = store::NewJob { spec, digest, ..evaluate(&data, &training, vec![]) };
    let reading = f.submit_one(reader).await;
    let checkpoints = f.store.checkpoints_of_job(trained).await.unwrap();
    let change = store::LabelChange { tags: Some(vec!["keep".to_owned()]), ..Default::default() };
    f.store.change_labels(store::ItemKind::Checkpoint, checkpoints[2].id.0, &change).await.unwrap();
    assert_eq!(f.store.outdated(keep(2)).await.unwrap(), [], "an open job reads the training");
    work(&f).await;
    assert_eq!(f.state(reading).await, JobState::Succeeded);
    let steps = |found: &[store::Outdated]| {
        let step = |outdated: &store::Outdated| {
            checkpoints
                .iter()
                .find(|found| outdated.item == found.id.into())
                .map(|found| found.step)
        };
        found.iter().filter_map(step).collect::<Vec<u64>>()
    };
    let found = f.store.outdated(keep(2)).await.unwrap();
    assert_eq!(steps(&found), [10, 40, 50]);
    assert_eq!(found[0].reason, "a training keeps its 2 newest checkpoints and the best");
    assert_eq!(f.store.retire(keep(2), LONG).await.unwrap(), found);
    let left = f.store.checkpoints_of_job(trained).await.unwrap();
    assert_eq!(left.iter().map(|checkpoint| checkpoint.step).collect::<Vec<_>>(), [20, 30, 60, 70]);
    assert_eq!(f.store.outdated(keep(2)).await.unwrap(), []);
}

pub async fn an_open_job_keeps_the_checkpoints_of_its_training_and_of_no_other(f: Fixture) {
    let mut trained = Vec::new();
    for seed in [1, 2] {
        let data = simulate(seed);
        f.submit_one(data.clone()).await;
        work(&f).await;
        let training = train(&data, vec![]);
        let job = f.submit_one(training.clone()).await;
        let task = f.must_claim().await;
        for step in [10, 20, 30] {
            checkpoint(&f, &task, step, step == 30).await;
        }
        f.store.complete(task.fence, None).await.unwrap();
        trained.push((job, data, training));
    }
    let keep = store::Retention { checkpoints: Some(1), ..store::Retention::default() };
    let outdated = async || f.store.outdated(keep).await.unwrap();
    assert_eq!(outdated().await.len(), 4, "nobody uses any");
    let checkpoints = f.store.checkpoints_of_job(trained[1].0).await.unwrap();
    let of_the_other: Vec<Item> =
        checkpoints[..2].iter().map(|checkpoint| checkpoint.id.into()).collect();

    let (job, data, training) = &trained[0];
    let reader = f.submit_one(evaluate(data, training, vec![])).await;
    let items =
        async || outdated().await.into_iter().map(|outdated| outdated.item).collect::<Vec<Item>>();
    assert_eq!(items().await, of_the_other, "it reads the first training");
    f.store.cancel(reader).await.unwrap();
    assert_eq!(outdated().await.len(), 4);
    let needs = vec![Need::Existing(*job)];
    let waiting = f.submit_one(evaluate(data, training, needs)).await;
    assert_eq!(items().await, of_the_other, "it needs the first training");
    f.store.cancel(waiting).await.unwrap();
    assert_eq!(outdated().await.len(), 4);
}

pub async fn old_logs_go_and_their_attempts_stay(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let line = store::NewLogChunk { position: 0, text: "here\n".to_owned() };
    f.store.append_log(task.fence, &[line]).await.unwrap();
    assert_eq!(f.store.outdated_logs(Duration::ZERO).await.unwrap(), [], "the job goes on");
    f.store.complete(task.fence, None).await.unwrap();
    assert_eq!(f.store.outdated_logs(LONG).await.unwrap(), []);
    assert_eq!(f.store.delete_old_logs(LONG).await.unwrap(), 0);
    tokio::time::sleep(Duration::from_millis(5)).await;
    assert_eq!(f.store.outdated_logs(Duration::ZERO).await.unwrap(), [job]);
    assert_eq!(f.store.delete_old_logs(Duration::ZERO).await.unwrap(), 1);
    let filter = store::LogFilter { jobs: vec![job], ..store::LogFilter::default() };
    let page = store::LogPage::After { id: 0, limit: 10 };
    assert_eq!(f.store.log_page(&filter, page).await.unwrap(), []);
    assert_eq!(f.store.delete_old_logs(Duration::ZERO).await.unwrap(), 0);
    assert_eq!(f.store.census().await.unwrap().attempts.len(), 1);
}
