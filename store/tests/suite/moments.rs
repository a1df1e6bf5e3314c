//! Moments are those of the database's clock.

use std::time::Duration;

use store::{JobId, Retry, Timestamp};

use super::{Fixture, simulate, train};

pub async fn a_job_is_created_started_and_finished_in_this_order(f: Fixture) {
    let id = f.submit_one(train(&simulate(1), vec![])).await;
    let job = f.store.job(id).await.unwrap();
    assert_eq!((job.started_at, job.finished_at), (None, None));
    let task = f.must_claim().await;
    f.store.complete(task.fence, None).await.unwrap();
    let job = f.store.job(id).await.unwrap();
    let (started, finished) = (job.started_at.unwrap(), job.finished_at.unwrap());
    assert!(job.created_at <= started && started <= finished, "{job:?}");
    let task = f.store.task(task.fence.task).await.unwrap();
    assert!(job.created_at <= task.started_at.unwrap());
    assert!(task.finished_at.unwrap() <= finished);
}

pub async fn a_lease_lasts_from_the_renewal_on(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let ttl = Duration::from_secs(100);
    let claimed = f.store.claim("w1", &spec::Resources::default(), ttl).await.unwrap().unwrap();
    let until = async || f.store.task(claimed.fence.task).await.unwrap().lease_until.unwrap();
    let first = until().await;
    tokio::time::sleep(Duration::from_millis(20)).await;
    f.store.renew(claimed.fence, ttl, &store::Progress::default()).await.unwrap();
    let second = until().await;
    assert!(second > first);
    let started = f.store.task(claimed.fence.task).await.unwrap().started_at.unwrap();
    let lasts = first.milliseconds() - started.milliseconds();
    assert!((100_000..110_000).contains(&lasts), "{lasts}");
}

pub async fn a_task_that_failed_keeps_its_first_start(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let first = f.must_claim().await;
    let started = f.store.task(first.fence.task).await.unwrap().started_at;
    f.store.fail(first.fence, "once", Retry::Allowed).await.unwrap();
    tokio::time::sleep(Duration::from_millis(5)).await;
    f.must_claim().await;
    assert_eq!(f.store.task(first.fence.task).await.unwrap().started_at, started);
}

pub async fn moments_are_those_of_today(f: Fixture) {
    let job: JobId = f.submit_one(simulate(1)).await;
    let created = f.store.job(job).await.unwrap().created_at;
    let now = std::time::UNIX_EPOCH.elapsed().unwrap().as_millis();
    let now = Timestamp::from_milliseconds(i64::try_from(now).unwrap());
    let apart = now.milliseconds() - created.milliseconds();
    assert!(apart.abs() < 600_000, "{created} is far from {now}");
}
