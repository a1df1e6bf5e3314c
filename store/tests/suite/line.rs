//! The order of waiting tasks, and the time from which they may run.

use spec::{Execution, Resources};
use store::{JobId, JobState, Need, Retry, StoreError, Wait};

use super::workers::worker;
use super::{Fixture, LONG, beginning, pipeline_of, simulate, train};

/// The jobs of the claimed tasks, each once, in order.
async fn order(f: &Fixture) -> Vec<JobId> {
    let mut jobs: Vec<JobId> = f.work_off().await.iter().map(|task| task.job).collect();
    jobs.dedup();
    jobs
}

pub async fn a_job_is_not_begun_before_its_moment(f: Fixture) {
    let now = f.store.now().await.unwrap();
    let later = beginning(simulate(1), now, 24);
    let moment = later.execution.not_before.unwrap();
    let later = f.submit_one(later).await;
    let passed = f.submit_one(beginning(simulate(2), now, -24)).await;
    let anytime = f.submit_one(simulate(3)).await;
    assert_eq!(f.store.job(later).await.unwrap().execution.not_before, Some(moment));
    assert_eq!(f.state(later).await, JobState::Queued);
    assert_eq!(order(&f).await, [passed, anytime]);
    assert!(f.claim().await.is_none());
    let waits = f.store.waits(&[later, passed]).await.unwrap();
    assert_eq!(waits, [(later, Wait::Until(moment))].into());
}

pub async fn a_moment_far_ahead_is_waited_for(f: Fixture) {
    // A delay of a retry that ends so late was set by another clock. A user's start time is valid.
    let now = f.store.now().await.unwrap();
    f.submit_one(beginning(simulate(1), now, 366 * 24)).await;
    assert!(f.claim().await.is_none());
}

pub async fn a_moment_that_has_passed_does_not_shorten_the_pause_before_a_retry(f: Fixture) {
    let now = f.store.now().await.unwrap();
    f.submit_one(beginning(train(&simulate(1), vec![]), now, -1)).await;
    for attempt in 1..=2 {
        let task = f.claim().await.unwrap();
        assert_eq!(task.attempt, attempt);
        f.store.fail(task.fence, "out of luck", Retry::Allowed).await.unwrap();
    }
    assert!(f.claim().await.is_none(), "the second retry waits");
}

pub async fn a_job_of_a_pipeline_may_begin_later_than_those_it_needs(f: Fixture) {
    let now = f.store.now().await.unwrap();
    let data = simulate(1);
    let trained = beginning(train(&data, vec![Need::New(0)]), now, 1);
    let submitted = f.submit(pipeline_of(vec![data, trained])).await;
    assert_eq!(f.work_off().await.len(), 3);
    let members = f.members(submitted.job).await;
    assert_eq!(f.states(&members).await, [JobState::Succeeded, JobState::Queued]);
    assert!(matches!(f.store.waits(&members).await.unwrap()[&members[1]], Wait::Until(_)));
}

pub async fn of_one_priority_the_older_job_goes_first_stage_by_stage(f: Fixture) {
    let data = simulate(1);
    let submitted =
        f.submit(pipeline_of(vec![data.clone(), train(&data, vec![Need::New(0)])])).await;
    let newer = f.submit_one(simulate(2)).await;
    let members = f.members(submitted.job).await;
    assert_eq!(order(&f).await, [members[0], members[1], newer]);
}

pub async fn a_drained_worker_ends_its_task_and_claims_no_other(f: Fixture) {
    let nothing = Resources::default();
    f.submit_one(simulate(1)).await;
    f.store.register_worker(&worker("w1", 1)).await.unwrap();
    let running = f.must_claim().await;
    f.store.drain_worker("w1").await.unwrap();
    let drained_at = f.store.workers().await.unwrap()[0].drained_at;
    assert!(drained_at.is_some() && f.claim().await.is_none());
    f.store.complete(running.fence, None).await.unwrap();
    assert!(f.claim().await.is_none());
    f.store.drain_worker("w1").await.unwrap();
    assert_eq!(f.store.workers().await.unwrap()[0].drained_at, drained_at, "it lasts");
    assert!(f.store.claim("w2", &nothing, LONG).await.unwrap().is_some(), "others go on");

    // A drained worker's successor after a crash is drained, too. After an orderly end it is not.
    f.store.register_worker(&worker("w1", 2)).await.unwrap();
    assert!(f.claim().await.is_none());
    f.store.undrain_worker("w1").await.unwrap();
    assert!(f.claim().await.is_some());
    f.store.drain_worker("w1").await.unwrap();
    f.store.forget_worker(&worker("w1", 2)).await.unwrap();
    f.store.register_worker(&worker("w1", 3)).await.unwrap();
    assert_eq!(f.store.workers().await.unwrap()[0].drained_at, None);
    for result in [f.store.drain_worker("w9").await, f.store.undrain_worker("w9").await] {
        assert!(matches!(result, Err(StoreError::NotFound { what: "worker", .. })), "{result:?}");
    }
}

pub async fn a_task_carries_the_time_limit_of_its_job(f: Fixture) {
    let execution = Execution { time_limit_s: Some(90), ..Execution::default() };
    let limited = store::NewJob { execution, ..train(&simulate(1), vec![]) };
    let job = f.submit_one(limited).await;
    let second = std::time::Duration::from_secs(1);
    assert_eq!(f.must_claim().await.time_limit, Some(90 * second));
    assert_eq!(f.store.job(job).await.unwrap().execution.time_limit_s, Some(90));
    f.submit_one(train(&simulate(2), vec![])).await;
    assert_eq!(f.must_claim().await.time_limit, None);
}
