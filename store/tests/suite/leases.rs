use std::collections::BTreeMap;
use std::collections::HashSet;
use std::time::Duration;

use serde_json::json;
use spec::Resources;
use store::{
    AttemptOutcome, Epoch, Fence, JobState, Lease, Metric, NewCheckpoint, Page, Progress, Reaped,
    Reaper, Retry, TaskState,
};

use super::{Fixture, LONG, assert_lost, simulate, task, train, with_execution};

pub async fn a_claimed_task_carries_all_that_its_worker_needs(f: Fixture) {
    let new = train(&simulate(1), vec![]);
    let job = f.submit_one(new.clone()).await;
    let claimed = f.must_claim().await;
    assert_eq!((claimed.job, claimed.digest), (job, new.digest));
    assert_eq!(claimed.spec, new.spec);
    assert_eq!(claimed.run, f.store.job(job).await.unwrap().run);
    assert_eq!((claimed.stage, claimed.ordinal, claimed.total), (0, 0, 10));
    assert_eq!((claimed.attempt, claimed.max_attempts, claimed.fence.epoch), (1, 3, Epoch(1)));
    assert_eq!(claimed.payload, json!({"piece": 0}));
    assert_eq!(f.state(job).await, JobState::Running);
    assert!(f.claim().await.is_none());
}

pub async fn a_killed_worker_loses_its_lease_and_its_late_writes(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let dead = f.claim_and_die().await.fence;
    assert_eq!(f.reap().await.queued, 1);
    let alive = f.must_claim().await;
    assert_eq!(alive.fence, Fence { task: dead.task, epoch: Epoch(2) });

    let lease = f.store.renew(dead, LONG, &Progress::default()).await.unwrap();
    assert_eq!(lease, Lease::Lost);
    assert_lost(f.store.complete(dead, None).await, dead);
    assert_lost(f.store.fail(dead, "late", Retry::Never).await, dead);
    assert_lost(f.store.release(dead).await, dead);
    assert_lost(f.store.stopped(dead).await, dead);
    let metric = Metric { key: "train/loss".into(), step: 1, value: 1.0 };
    assert_lost(f.store.record_metrics(dead, &[metric]).await, dead);
    assert_lost(f.store.delete_metrics_after(dead, 0).await, dead);
    let checkpoint = NewCheckpoint {
        step: 1,
        is_final: true,
        is_best: true,
        metrics: BTreeMap::new(),
        files: vec![],
    };
    assert_lost(f.store.commit_checkpoint(dead, &checkpoint).await, dead);
    assert_lost(f.store.prune_checkpoints(dead, 1).await, dead);
    let artifact =
        store::NewArtifact { name: "a.txt", media_type: "text/plain", bytes: "a".into() };
    assert_lost(f.store.put_artifact(dead, artifact).await, dead);

    f.store.complete(alive.fence, None).await.unwrap();
    assert_eq!(f.state(alive.job).await, JobState::Succeeded);
}

pub async fn a_lease_that_is_renewed_is_not_reaped(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let fence = f.claim_and_die().await.fence;
    let progress = Progress { done: 4, rate_per_second: Some(2.0), message: Some("hm".into()) };
    let lease = f.store.renew(fence, LONG, &progress).await.unwrap();
    assert_eq!(lease, Lease::Held { cancel_requested: false });
    assert_eq!(f.reap().await, Reaped::default());
    let task = f.store.task(fence.task).await.unwrap();
    assert_eq!((task.state, &task.progress), (TaskState::Running, &progress));
    let of_job = f.store.job(task.job).await.unwrap().progress;
    assert_eq!((of_job.done, of_job.total, of_job.unit.as_str()), (4, 10, "steps"));
    assert_eq!((of_job.rate_per_second, of_job.message.as_deref()), (Some(2.0), Some("hm")));
}

pub async fn a_task_that_kills_its_worker_fails_after_max_attempts(f: Fixture) {
    let job = f.submit_one(with_execution(train(&simulate(1), vec![]), 0, 2)).await;
    assert_eq!(f.claim_and_die().await.attempt, 1);
    assert_eq!(f.reap().await.queued, 1);
    assert_eq!(f.claim_and_die().await.attempt, 2);
    assert_eq!(f.reap().await.failed, 1);
    assert!(f.claim().await.is_none());
    assert_eq!(f.state(job).await, JobState::Failed);
    let error = f.error(job).await;
    assert_eq!(error, "piece 0.0: worker w0 stopped answering (attempt 2 of 2)");
}

pub async fn the_first_retry_comes_at_once_and_the_second_later(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let first = f.must_claim().await;
    f.store.fail(first.fence, "out of luck", Retry::Allowed).await.unwrap();
    let second = f.must_claim().await;
    assert_eq!(second.attempt, 2);
    f.store.fail(second.fence, "out of luck", Retry::Allowed).await.unwrap();
    assert!(f.claim().await.is_none(), "the second retry waits");
    let task = f.store.task(second.fence.task).await.unwrap();
    assert_eq!(task.state, TaskState::Queued);
    assert_eq!(task.error.as_deref(), Some("out of luck (attempt 2 of 3)"));
}

pub async fn a_failure_that_would_repeat_is_not_retried(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, "bad data", Retry::Never).await.unwrap();
    assert_eq!(
        (f.state(job).await, f.error(job).await.as_str()),
        (JobState::Failed, "piece 0.0: bad data")
    );
}

pub async fn a_released_task_is_claimed_again_without_losing_an_attempt(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    for epoch in 1..=5 {
        let task = f.must_claim().await;
        assert_eq!((task.attempt, task.fence.epoch), (1, Epoch(epoch)));
        f.store.release(task.fence).await.unwrap();
    }
}

pub async fn tasks_are_claimed_by_priority_and_then_in_order(f: Fixture) {
    let low = f.submit_one(with_execution(simulate(1), -1, 3)).await;
    let first = f.submit_one(simulate(2)).await;
    let second = f.submit_one(simulate(3)).await;
    let high = f.submit_one(with_execution(simulate(4), 5, 3)).await;
    let claimed = f.work_off().await;
    let order: Vec<_> = claimed.iter().map(|task| (task.job, task.ordinal)).collect();
    let expected: Vec<_> =
        [high, first, second, low].into_iter().flat_map(|j| [(j, 0), (j, 1), (j, 2)]).collect();
    assert_eq!(order, expected);
}

pub async fn two_claimers_never_get_the_same_task(f: Fixture) {
    let mut new = simulate(1);
    new.tasks = (0..60).map(|ordinal| task(0, ordinal, 1)).collect();
    let job = f.submit_one(new).await;
    let workers: Vec<_> = (0..8)
        .map(|i| {
            let store = f.store.clone();
            tokio::spawn(async move {
                let mut claimed = Vec::new();
                while let Some(task) =
                    store.claim(&format!("w{i}"), &Resources::default(), LONG).await.unwrap()
                {
                    claimed.push(task.fence.task);
                    store.complete(task.fence, None).await.unwrap();
                }
                claimed
            })
        })
        .collect();
    let mut claimed = Vec::new();
    for worker in workers {
        claimed.extend(worker.await.unwrap());
    }
    assert_eq!(claimed.len(), 60);
    assert_eq!(claimed.iter().collect::<HashSet<_>>().len(), 60);
    assert_eq!(f.state(job).await, JobState::Succeeded);
}

pub async fn a_finished_task_takes_no_second_ending(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let fence = f.must_claim().await.fence;
    f.store.complete(fence, Some(&json!({"loss": 0.5}))).await.unwrap();
    assert_lost(f.store.fail(fence, "no", Retry::Never).await, fence);
    assert_lost(f.store.complete(fence, None).await, fence);
    tokio::time::sleep(Duration::from_millis(2)).await;
    f.reap().await;
    let task = f.store.task(fence.task).await.unwrap();
    assert_eq!((task.state, task.result), (TaskState::Succeeded, Some(json!({"loss": 0.5}))));
    assert_eq!(task.progress.done, task.total);
}

/// A sleeping laptop stops its server and its workers alike.
pub async fn leases_outlive_a_sleep_of_everybody(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let fence = f.must_claim().await.fence;
    let mut reaper = Reaper::new(f.store.clone(), Duration::from_secs(1));
    for _ in 0..5 {
        assert_eq!(reaper.look(20 * LONG).await.unwrap(), Reaped::default());
    }
    let lease = f.store.renew(fence, LONG, &Progress::default()).await.unwrap();
    assert_eq!(lease, Lease::Held { cancel_requested: false });
}

pub async fn a_worker_that_never_renews_is_noticed(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let second = Duration::from_secs(1);
    f.store.claim("w0", &Resources::default(), 3 * second).await.unwrap().unwrap();
    let mut reaper = Reaper::new(f.store.clone(), second);
    for _ in 0..3 {
        assert_eq!(reaper.look(second).await.unwrap(), Reaped::default());
    }
    assert_eq!(reaper.look(second).await.unwrap().queued, 1);
    assert_eq!(f.must_claim().await.attempt, 2);
}

pub async fn attempts_before_a_later_checkpoint_do_not_count(f: Fixture) {
    let keep = async |fence: Fence, step: u64| {
        let metrics = BTreeMap::new();
        let new = NewCheckpoint { step, is_final: false, is_best: false, metrics, files: vec![] };
        f.store.commit_checkpoint(fence, &new).await.unwrap();
    };
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    for step in [2, 3, 5, 8] {
        let task = f.claim_and_die().await;
        assert!(task.attempt <= 2, "the one before had got on");
        keep(task.fence, step).await;
        assert_eq!(f.reap().await.queued, 1);
    }
    let task = f.claim_and_die().await;
    keep(task.fence, 8).await;
    assert_eq!((task.attempt, f.reap().await.queued), (2, 1));
    tokio::time::sleep(Duration::from_millis(1)).await;
    assert!(f.claim().await.is_none(), "the same step again is no progress, and the retry waits");
    assert_eq!(f.state(job).await, JobState::Running);
}

pub async fn every_attempt_is_recorded_with_its_end(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    f.store.release(f.must_claim().await.fence).await.unwrap();
    f.store.fail(f.must_claim().await.fence, "out of luck", Retry::Allowed).await.unwrap();
    let last = f.must_claim().await;
    let page = Page::default();
    let attempts = f.store.attempts(job, page).await.unwrap();
    let outcomes: Vec<_> =
        attempts.iter().map(|attempt| (attempt.epoch.0, attempt.outcome)).collect();
    let (released, failed) = (AttemptOutcome::Released, AttemptOutcome::Failed);
    assert_eq!(outcomes, [(3, None), (2, Some(failed)), (1, Some(released))]);
    assert_eq!(attempts[1].reason.as_deref(), Some("out of luck"));
    assert_eq!((attempts[0].worker.as_str(), attempts[0].label.as_str()), ("w1", "piece 0.0"));
    assert!(attempts[0].ended_at.is_none() && attempts[1].ended_at.is_some());

    f.store.complete(last.fence, None).await.unwrap();
    let attempts = f.store.attempts(job, Page { limit: 1, ..page }).await.unwrap();
    let ended: Vec<_> = attempts.iter().map(|attempt| (attempt.epoch.0, attempt.outcome)).collect();
    assert_eq!(ended, [(3, Some(AttemptOutcome::Succeeded))]);
    let older = Page { before: Some(attempts[0].id), ..page };
    assert_eq!(f.store.attempts(job, older).await.unwrap().len(), 2);
}

pub async fn an_attempt_that_was_cancelled_or_lost_says_so(f: Fixture) {
    let lost = f.submit_one(train(&simulate(1), vec![])).await;
    f.claim_and_die().await;
    f.reap().await;
    let attempts = f.store.attempts(lost, Page::default()).await.unwrap();
    assert_eq!(attempts[0].reason.as_deref(), Some("worker w0 stopped answering"));
    let task = f.must_claim().await;
    f.store.cancel(lost).await.unwrap();
    f.store.stopped(task.fence).await.unwrap();
    let attempts = f.store.attempts(lost, Page::default()).await.unwrap();
    assert_eq!(attempts[0].outcome, Some(AttemptOutcome::Cancelled));
}

pub async fn a_paused_queue_hands_out_nothing_and_takes_everything(f: Fixture) {
    f.submit_one(simulate(1)).await;
    let running = f.must_claim().await;
    f.store.pause_queue().await.unwrap();
    let paused = f.store.queue().await.unwrap();
    assert_eq!((paused.paused_at.is_some(), paused.queued, paused.running), (true, 2, 1));
    assert!(f.claim().await.is_none());
    f.submit_one(simulate(2)).await;
    assert!(f.claim().await.is_none());
    f.store.complete(running.fence, None).await.unwrap();
    f.store.pause_queue().await.unwrap();
    let still = f.store.queue().await.unwrap();
    assert_eq!((still.paused_at, still.queued, still.running), (paused.paused_at, 5, 0));
    f.store.resume_queue().await.unwrap();
    assert_eq!(f.store.queue().await.unwrap().paused_at, None);
    assert_eq!(f.work_off().await.len(), 5);
}
