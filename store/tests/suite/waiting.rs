use std::time::Duration;

use store::{Retry, Store};
use tokio::task::JoinHandle;

use super::{Fixture, LONG, alone, evaluate, simulate, train};

/// Longer than a ring in these tests takes.
const IN_VAIN: Duration = Duration::from_millis(300);

/// A client that waits for news of a task, from now on.
async fn waiting(store: &Store, longest: Duration) -> JoinHandle<bool> {
    let mut bell = store.bell().await.unwrap();
    tokio::spawn(async move { tokio::time::timeout(longest, bell.wait(LONG)).await.is_ok() })
}

pub async fn a_task_that_is_submitted_rings(f: Fixture) {
    let heard = waiting(&f.store, LONG).await;
    f.submit_one(train(&simulate(1), vec![])).await;
    assert!(heard.await.unwrap());
}

pub async fn all_who_wait_hear_it(f: Fixture) {
    let mut all = Vec::new();
    for _ in 0..4 {
        all.push(waiting(&f.store, LONG).await);
    }
    f.submit_one(simulate(1)).await;
    for heard in all {
        assert!(heard.await.unwrap());
    }
}

pub async fn a_task_that_is_given_back_rings(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let heard = waiting(&f.store, LONG).await;
    f.store.release(task.fence).await.unwrap();
    assert!(heard.await.unwrap());
    let task = f.must_claim().await;
    let heard = waiting(&f.store, LONG).await;
    f.store.fail(task.fence, "once more", Retry::Allowed).await.unwrap();
    assert!(heard.await.unwrap());
}

pub async fn the_next_stage_rings(f: Fixture) {
    let job = evaluate(&simulate(1), &simulate(2), vec![]);
    f.submit_one(job).await;
    let (first, second) = (f.must_claim().await, f.must_claim().await);
    f.store.complete(first.fence, None).await.unwrap();
    let heard = waiting(&f.store, LONG).await;
    f.store.complete(second.fence, None).await.unwrap();
    assert!(heard.await.unwrap());
}

pub async fn the_end_of_a_pause_rings(f: Fixture) {
    f.store.pause_queue().await.unwrap();
    f.submit_one(simulate(1)).await;
    let heard = waiting(&f.store, LONG).await;
    f.store.resume_queue().await.unwrap();
    assert!(heard.await.unwrap());
    assert!(f.claim().await.is_some());
}

pub async fn what_queues_nothing_rings_for_nobody(f: Fixture) {
    f.submit_one(simulate(1)).await;
    let task = f.must_claim().await;
    let heard = waiting(&f.store, IN_VAIN).await;
    f.store.renew(task.fence, LONG, &store::Progress::default()).await.unwrap();
    f.submit(alone(simulate(1))).await;
    let worker = super::workers::worker("w1", 1);
    f.store.register_worker(&worker).await.unwrap();
    f.store.check_database().await.unwrap();
    assert!(!heard.await.unwrap());
}

pub async fn whoever_waits_looks_by_itself_after_a_while(f: Fixture) {
    let mut bell = f.store.bell().await.unwrap();
    tokio::time::timeout(LONG, bell.wait(Duration::from_millis(1))).await.unwrap().unwrap();
}
