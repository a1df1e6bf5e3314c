use store::{AttemptOutcome, Engine, Page, Placed, PlacementState, WorkerEnd};

use super::{Fixture, simulate, train};

fn placed(state: PlacementState, reason: Option<&str>, node: Option<&str>) -> Placed {
    Placed {
        worker: "torqued-ab-1".to_owned(),
        engine: "Slurm".to_owned(),
        identifier: Some("17".to_owned()),
        state,
        reason: reason.map(str::to_owned),
        node: node.map(str::to_owned),
    }
}

pub async fn the_engine_and_its_obstacle_are_shown_until_there_is_none(f: Fixture) {
    assert_eq!(f.store.engine().await.unwrap(), None);
    for obstacle in [None, Some("squeue failed".to_owned()), None] {
        let engine = Engine { name: "Slurm".to_owned(), obstacle };
        f.store.set_engine(Some(&engine)).await.unwrap();
        assert_eq!(f.store.engine().await.unwrap(), Some(engine));
    }
    f.store.set_engine(None).await.unwrap();
    assert_eq!(f.store.engine().await.unwrap(), None);
}

pub async fn a_placement_is_kept_as_the_engine_showed_it_last(f: Fixture) {
    let pending = placed(PlacementState::Pending, Some("Resources"), None);
    let running = placed(PlacementState::Running, None, Some("n1"));
    let ended = placed(PlacementState::Ended, Some("lost its node"), None);
    for shown in [&pending, &running, &ended] {
        f.store.record_placements(std::slice::from_ref(shown)).await.unwrap();
    }
    let records = f.store.placements().await.unwrap();
    assert_eq!(records.len(), 1);
    // Its node is still known after the engine has forgotten the worker.
    assert_eq!(records[0].placed, Placed { node: Some("n1".to_owned()), ..ended });
    assert!(records[0].asked_at <= records[0].changed_at);
    f.store.record_placements(&[running]).await.unwrap();
    let after = f.store.placements().await.unwrap();
    assert_eq!(after, records, "it ended");
}

pub async fn a_worker_that_was_interrupted_loses_no_attempt_and_the_reason_is_known(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let interrupted = f.must_claim().await;
    let end = WorkerEnd::Interrupted("was preempted by Slurm");
    assert_eq!(f.store.take_back("w1", end).await.unwrap().queued, 1);
    let attempts = f.store.attempts(job, Page::default()).await.unwrap();
    assert_eq!(attempts[0].outcome, Some(AttemptOutcome::Released));
    assert_eq!(attempts[0].reason.as_deref(), Some("worker w1 was preempted by Slurm"));
    assert_eq!(f.store.task(interrupted.fence.task).await.unwrap().error, None);
    assert_eq!(f.must_claim().await.attempt, 1);
}

pub async fn why_a_worker_put_its_task_down_in_time_is_known_afterwards(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    assert!(!f.store.has_begun_a_task("w1").await.unwrap());
    f.store.release(f.must_claim().await.fence).await.unwrap();
    assert!(f.store.has_begun_a_task("w1").await.unwrap());
    f.store.take_back("w1", WorkerEnd::Died("lost its node")).await.unwrap();
    let attempts = f.store.attempts(job, Page::default()).await.unwrap();
    let ended = (attempts[0].outcome, attempts[0].reason.as_deref());
    assert_eq!(ended, (Some(AttemptOutcome::Released), Some("worker w1 lost its node")));

    f.store.release(f.must_claim().await.fence).await.unwrap();
    let end = WorkerEnd::Interrupted("was preempted by Slurm");
    f.store.take_back("w1", end).await.unwrap();
    let attempts = f.store.attempts(job, Page::default()).await.unwrap();
    assert_eq!(attempts[0].reason.as_deref(), Some("worker w1 was preempted by Slurm"));
    // An attempt that ended in another way keeps its reason.
    let task = f.must_claim().await;
    f.store.complete(task.fence, None).await.unwrap();
    f.store.take_back("w1", end).await.unwrap();
    let attempts = f.store.attempts(job, Page::default()).await.unwrap();
    assert_eq!(
        (attempts[0].outcome, &attempts[0].reason),
        (Some(AttemptOutcome::Succeeded), &None)
    );
}
