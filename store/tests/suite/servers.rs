use store::{AttemptOutcome, Census, Duty, JobState, Queue, TaskState};

use super::{Fixture, simulate, train};

pub async fn the_version_of_the_last_server_is_known(f: Fixture) {
    assert_eq!(f.store.server_version().await.unwrap(), None);
    f.store.register_server("1.2.3").await.unwrap();
    f.store.register_server("1.3.0").await.unwrap();
    assert_eq!(f.store.server_version().await.unwrap().as_deref(), Some("1.3.0"));
}

pub async fn a_store_keeps_its_identity(f: Fixture) {
    let identity = f.store.identity().await.unwrap();
    assert!(identity.len() == 32 && identity.chars().all(|c| c.is_ascii_hexdigit()), "{identity}");
    assert_eq!(f.store.identity().await.unwrap(), identity);
}

pub async fn a_server_alone_has_every_duty(f: Fixture) {
    for duty in [Duty::Reaping, Duty::Sweeping, Duty::Placing] {
        let mut claim = f.store.duty(duty);
        assert!(claim.is_mine().await.unwrap());
        assert!(claim.is_mine().await.unwrap());
    }
}

pub async fn a_database_that_answers_can_be_written(f: Fixture) {
    f.store.ping().await.unwrap();
    f.store.check_database().await.unwrap();
    f.store.check_database().await.unwrap();
    assert_eq!(f.store.obstacle(), None);
}

pub async fn the_queue_is_counted(f: Fixture) {
    let counts = |queue: Queue| (queue.queued, queue.running, queue.paused_at.is_some());
    assert_eq!(counts(f.store.queue().await.unwrap()), (0, 0, false));
    f.submit_one(simulate(1)).await;
    f.must_claim().await;
    assert_eq!(counts(f.store.queue().await.unwrap()), (2, 1, false));
    f.store.pause_queue().await.unwrap();
    let paused = f.store.queue().await.unwrap();
    f.store.pause_queue().await.unwrap();
    assert_eq!(f.store.queue().await.unwrap(), paused, "the moment of the first pause stays");
    f.store.resume_queue().await.unwrap();
    f.store.resume_queue().await.unwrap();
    assert_eq!(counts(f.store.queue().await.unwrap()), (2, 1, false));
}

pub async fn everything_is_counted_by_kind(f: Fixture) {
    assert_eq!(f.store.census().await.unwrap(), Census::default());
    f.submit_one(train(&simulate(1), vec![])).await;
    f.store.release(f.must_claim().await.fence).await.unwrap();
    f.must_claim().await;
    let Census { jobs, tasks, attempts } = f.store.census().await.unwrap();
    assert_eq!(jobs, [("train".to_owned(), JobState::Running, 1)]);
    assert_eq!(tasks, [("train".to_owned(), TaskState::Running, 1)]);
    assert_eq!(attempts.len(), 2);
    for outcome in [None, Some(AttemptOutcome::Released)] {
        assert!(attempts.contains(&("train".to_owned(), outcome, 1)), "{attempts:?}");
    }
}
