use std::time::Duration;

use spec::{Digest, Resources};
use store::{JobState, Lease, Need, Progress, Reaped, Retry, Submission, TaskState};

use super::{Fixture, LONG, alone, pipeline, simulate, train};

pub async fn tasks_that_nobody_has_are_cancelled_at_once(f: Fixture) {
    let submitted = f.submit(pipeline(1)).await;
    let members = f.members(submitted.job).await;
    f.store.cancel(members[1]).await.unwrap();
    use JobState::{Cancelled, Queued};
    assert_eq!(f.states(&members).await, [Queued, Cancelled, Cancelled]);
    assert_eq!(f.error(members[2]).await, format!("needs job {}, which was cancelled", members[1]));
    f.work_off().await;
    assert_eq!(f.state(submitted.job).await, Cancelled);
    assert_eq!(f.error(submitted.job).await, format!("train (job {}) was cancelled", members[1]));
}

pub async fn a_running_task_is_told_and_then_ends_its_job(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let (first, second) = (f.must_claim().await.fence, f.must_claim().await.fence);
    f.store.cancel(job).await.unwrap();
    assert_eq!(f.state(job).await, JobState::Running);
    assert!(f.claim().await.is_none());
    let lease = f.store.renew(first, LONG, &Progress::default()).await.unwrap();
    assert_eq!(lease, Lease::Held { cancel_requested: true });
    f.store.stopped(first).await.unwrap();
    assert_eq!(f.state(job).await, JobState::Running);
    // The second one noticed too late. It succeeded, but the job was cancelled.
    f.store.complete(second, None).await.unwrap();
    assert_eq!(f.state(job).await, JobState::Cancelled);
    let states: Vec<_> = f.store.tasks(job).await.unwrap().iter().map(|task| task.state).collect();
    assert_eq!(states, [TaskState::Cancelled, TaskState::Succeeded, TaskState::Cancelled]);
}

pub async fn a_cancelled_task_is_not_tried_again(f: Fixture) {
    for ending in 0..3 {
        let job = f.submit_one(train(&simulate(ending), vec![])).await;
        let fence =
            f.store.claim("w", &Resources::default(), Duration::ZERO).await.unwrap().unwrap().fence;
        f.store.cancel(job).await.unwrap();
        tokio::time::sleep(Duration::from_millis(3)).await;
        match ending {
            0 => f.store.fail(fence, "interrupted", Retry::Allowed).await.unwrap(),
            1 => f.store.release(fence).await.unwrap(),
            _ => {
                let reaped = f.reap().await;
                assert_eq!(reaped, Reaped { cancelled: 1, ..Reaped::default() });
            }
        }
        assert_eq!(f.state(job).await, JobState::Cancelled);
    }
}

pub async fn what_has_ended_cannot_be_cancelled(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    f.work_off().await;
    f.store.cancel(job).await.unwrap();
    let job = f.store.job(job).await.unwrap();
    assert_eq!((job.state, job.cancel_requested), (JobState::Succeeded, false));
}

pub async fn a_cancelled_pipeline_cancels_its_members(f: Fixture) {
    let submitted = f.submit(pipeline(1)).await;
    let members = f.members(submitted.job).await;
    let task = f.must_claim().await;
    f.store.cancel(submitted.job).await.unwrap();
    use JobState::{Cancelled, Running};
    assert_eq!(f.states(&members).await, [Running, Cancelled, Cancelled]);
    assert_eq!(f.state(submitted.job).await, Running);
    f.store.stopped(task.fence).await.unwrap();
    assert_eq!(f.states(&members).await, [Cancelled; 3]);
    assert_eq!(f.state(submitted.job).await, Cancelled);
}

pub async fn a_cancelled_pipeline_spares_what_others_need(f: Fixture) {
    // One is asked for alone, one is a member of another pipeline, and a job outside needs one.
    let asked_alone = f.submit_one(simulate(1)).await;
    let first = f.submit(pipeline(1)).await;
    let mut renamed = pipeline(1);
    renamed.pipeline.as_mut().unwrap().job.digest = Digest::of(b"renamed");
    renamed.jobs.pop();
    renamed.pipeline.as_mut().unwrap().members.pop();
    let second = f.submit(renamed).await;
    let members = f.members(first.job).await;

    f.store.cancel(first.job).await.unwrap();
    use JobState::{Cancelled, Queued, Waiting};
    assert_eq!(members[0], asked_alone);
    assert_eq!(f.states(&members).await, [Queued, Waiting, Cancelled]);
    assert_eq!(f.state(first.job).await, Cancelled);

    f.store.cancel(second.job).await.unwrap();
    assert_eq!(f.states(&members).await, [Queued, Cancelled, Cancelled]);
    f.work_off().await;
    assert_eq!(f.state(asked_alone).await, JobState::Succeeded);
}

pub async fn a_member_that_a_job_outside_needs_goes_on(f: Fixture) {
    let submission = Submission { ..super::pipeline_of(vec![simulate(1)]) };
    let submitted = f.submit(submission).await;
    let simulation = f.members(submitted.job).await[0];
    let outside = alone(train(&simulate(1), vec![Need::Existing(simulation)]));
    let training = f.submit(outside).await.job;
    f.store.cancel(submitted.job).await.unwrap();
    assert_eq!(f.state(submitted.job).await, JobState::Cancelled);
    f.work_off().await;
    assert_eq!(f.states(&[simulation, training]).await, [JobState::Succeeded; 2]);
}
