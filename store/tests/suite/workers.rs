use spec::Resources;
use store::{WorkerEnd, WorkerProcess};

use super::{Fixture, simulate, train};

pub fn worker(name: &str, pid: u32) -> WorkerProcess {
    WorkerProcess {
        name: name.to_owned(),
        host: "lab-3".to_owned(),
        pid,
        version: "1.2.3".to_owned(),
        device: "cpu".to_owned(),
        threads: 2,
        offers: Resources::default(),
    }
}

pub async fn a_worker_is_listed_with_its_task_until_it_leaves(f: Fixture) {
    f.store.register_worker(&worker("w2", 2)).await.unwrap();
    f.store.register_worker(&worker("w1", 1)).await.unwrap();
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let workers = f.store.workers().await.unwrap();
    let names: Vec<_> = workers.iter().map(|worker| worker.process.name.as_str()).collect();
    assert_eq!(names, ["w1", "w2"]);
    assert!(workers.iter().all(|worker| worker.is_alive && worker.waits_for.is_none()));
    let has = workers[0].task.as_ref().unwrap();
    assert_eq!((has.id, has.job, has.label.as_str()), (task.fence.task, task.job, "piece 0.0"));
    assert_eq!(workers[1].task, None);

    f.store.see_worker(&worker("w2", 2), Some("the disk is full")).await.unwrap();
    f.store.forget_worker(&worker("w1", 1)).await.unwrap();
    let workers = f.store.workers().await.unwrap();
    assert_eq!(workers.len(), 1);
    assert_eq!(workers[0].waits_for.as_deref(), Some("the disk is full"));
}

pub async fn a_worker_that_began_anew_is_not_forgotten_by_the_one_before(f: Fixture) {
    f.store.register_worker(&worker("w1", 1)).await.unwrap();
    f.store.register_worker(&worker("w1", 7)).await.unwrap();
    f.store.see_worker(&worker("w1", 1), Some("old")).await.unwrap();
    f.store.forget_worker(&worker("w1", 1)).await.unwrap();
    let workers = f.store.workers().await.unwrap();
    assert_eq!((workers.len(), workers[0].process.pid, &workers[0].waits_for), (1, 7, &None));
}

pub async fn the_task_of_a_worker_that_died_goes_to_the_next_at_once(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let dead = f.must_claim().await;
    assert_eq!(f.store.take_back("somebody else", WorkerEnd::Stopped).await.unwrap().queued, 0);
    let reaped = f.store.take_back("w1", WorkerEnd::Died("died: signal 9")).await.unwrap();
    assert_eq!(reaped.queued, 1);
    let task = f.store.task(dead.fence.task).await.unwrap();
    assert_eq!(task.error.as_deref(), Some("worker w1 died: signal 9 (attempt 1 of 3)"));
    assert_eq!(f.must_claim().await.attempt, 2);
}

pub async fn a_worker_that_was_told_to_stop_loses_no_attempt(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    f.must_claim().await;
    assert_eq!(f.store.take_back("w1", WorkerEnd::Stopped).await.unwrap().queued, 1);
    assert_eq!(f.must_claim().await.attempt, 1);
}
