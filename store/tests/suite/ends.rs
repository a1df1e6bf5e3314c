//! The ends of tasks, apart from leases.

use serde_json::json;
use store::{AttemptOutcome, JobState, Page, Retry, TaskState};

use super::{Fixture, assert_lost, evaluate, simulate, train, with_execution};

pub async fn a_task_may_be_done_before_all_that_was_planned(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    f.store.complete_early(task.fence, 4, &json!({"why": "it got no better"})).await.unwrap();
    let progress = f.store.job(job).await.unwrap().progress;
    assert_eq!((progress.done, progress.total), (4, 4));
    assert_eq!(f.state(job).await, JobState::Succeeded);
    assert_lost(f.store.complete_early(task.fence, 4, &json!(null)).await, task.fence);
    assert_lost(f.store.set_total(task.fence, 9).await, task.fence);
}

pub async fn the_first_failure_is_the_jobs(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let (first, second) = (f.must_claim().await, f.must_claim().await);
    f.store.fail(second.fence, "second", Retry::Never).await.unwrap();
    assert_eq!(f.error(job).await, "piece 0.1: second");
    assert_eq!(f.state(job).await, JobState::Failed);
    let task = f.store.task(first.fence.task).await.unwrap();
    assert!(task.cancel_requested && task.state == TaskState::Running);
    f.store.stopped(first.fence).await.unwrap();
    assert_eq!(f.error(job).await, "piece 0.1: second");
}

pub async fn tasks_that_wait_are_cancelled_with_a_job_that_failed(f: Fixture) {
    let job = f.submit_one(evaluate(&simulate(1), &simulate(2), vec![])).await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, "no", Retry::Never).await.unwrap();
    let states: Vec<_> = f.store.tasks(job).await.unwrap().iter().map(|task| task.state).collect();
    assert_eq!(states, [TaskState::Failed, TaskState::Cancelled, TaskState::Cancelled]);
    assert!(f.claim().await.is_none());
}

pub async fn a_task_that_succeeds_at_last_has_no_error(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, "once", Retry::Allowed).await.unwrap();
    let task = f.must_claim().await;
    f.store.complete(task.fence, None).await.unwrap();
    let found = f.store.task(task.fence.task).await.unwrap();
    assert_eq!((found.state, found.error, found.attempt), (TaskState::Succeeded, None, 2));
    assert_eq!((found.lease_until, found.progress.rate_per_second), (None, None));
}

/// Caught: a full disk failed a job after three attempts.
pub async fn a_task_that_found_no_room_waits_and_no_attempt_is_counted(f: Fixture) {
    let job = f.submit_one(with_execution(simulate(1), 0, 1)).await;
    let task = f.must_claim().await;
    f.store.defer(task.fence, "disk full").await.unwrap();
    assert_lost(f.store.defer(task.fence, "disk full").await, task.fence);
    let found = f.store.task(task.fence.task).await.unwrap();
    assert_eq!((found.state, found.attempt), (TaskState::Queued, 0));
    assert_eq!(found.error.as_deref(), Some("disk full"));
    let attempts = f.store.attempts(job, Page { limit: 3, before: None }).await.unwrap();
    assert_eq!(attempts[0].outcome, Some(AttemptOutcome::Released));
    assert_eq!(attempts[0].reason.as_deref(), Some("disk full"));
    // Others have their turn meanwhile, and the job goes on.
    let others = f.work_off().await;
    assert_eq!(others.iter().map(|other| other.ordinal).collect::<Vec<_>>(), [1, 2]);
    assert_eq!(f.state(job).await, JobState::Running);
}

pub async fn attempts_are_read_in_pages(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    for _ in 0..5 {
        let task = f.must_claim().await;
        f.store.release(task.fence).await.unwrap();
    }
    let first = f.store.attempts(job, Page { limit: 3, before: None }).await.unwrap();
    assert_eq!(first.iter().map(|attempt| attempt.epoch.0).collect::<Vec<_>>(), [5, 4, 3]);
    let before = first.last().map(|attempt| attempt.id);
    let second = f.store.attempts(job, Page { limit: 3, before }).await.unwrap();
    assert_eq!(second.iter().map(|attempt| attempt.epoch.0).collect::<Vec<_>>(), [2, 1]);
    assert!(second.iter().all(|attempt| attempt.outcome == Some(AttemptOutcome::Released)));
}

pub async fn progress_of_a_job_is_that_of_its_tasks(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let (first, second) = (f.must_claim().await, f.must_claim().await);
    let sent = |rate| store::Progress { done: 1, rate_per_second: Some(rate), message: None };
    f.store.renew(first.fence, super::LONG, &sent(2.0)).await.unwrap();
    f.store.renew(second.fence, super::LONG, &sent(0.5)).await.unwrap();
    let progress = f.store.job(job).await.unwrap().progress;
    assert_eq!((progress.done, progress.total), (2, 6));
    assert_eq!((progress.rate_per_second, progress.unit.as_str()), (Some(2.5), "trajectories"));
    f.store.complete(first.fence, None).await.unwrap();
    let progress = f.store.job(job).await.unwrap().progress;
    assert_eq!((progress.done, progress.rate_per_second), (3, Some(0.5)));
}

pub async fn an_attempt_begins_its_progress_anew(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let sent =
        store::Progress { done: 7, rate_per_second: Some(1.0), message: Some("on".to_owned()) };
    f.store.renew(task.fence, super::LONG, &sent).await.unwrap();
    f.store.release(task.fence).await.unwrap();
    f.must_claim().await;
    let found = f.store.task(task.fence.task).await.unwrap();
    assert_eq!(found.progress, store::Progress::default());
}
