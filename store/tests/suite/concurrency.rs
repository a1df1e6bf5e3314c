//! Sixteen clients at once.

use std::cmp::Reverse;
use std::collections::HashSet;
use std::future::Future;
use std::time::Duration;

use serde_json::json;
use spec::{Digest, Resources};
use store::{
    ClaimedTask, FileContent, Idempotency, JobId, JobState, Lease, Metric, Need, NewJob, Page,
    Progress, Reaper, Retry, ShardContents, Store, StoreError, TaskState, WorkerEnd, object_path,
};

use super::{Fixture, LONG, alone, evaluate, pipeline, simulate, task, train};

const CLIENTS: u64 = 16;

/// Runs many clients that begin together, and gives their answers.
async fn at_once<F>(f: &Fixture, client: impl Fn(Store, u64) -> F) -> Vec<F::Output>
where
    F: Future<Output: Send> + Send + 'static,
{
    let begun: Vec<_> =
        (0..CLIENTS).map(|number| tokio::spawn(client(f.store.clone(), number))).collect();
    let mut answers = Vec::new();
    for answer in begun {
        answers.push(answer.await.unwrap());
    }
    answers
}

/// A job of many tasks in one stage.
fn wide(seed: u64, tasks: u32) -> NewJob {
    NewJob { tasks: (0..tasks).map(|ordinal| task(0, ordinal, 2)).collect(), ..simulate(seed) }
}

/// Claims tasks until none is left.
async fn claim_all(store: &Store, worker: &str) -> Vec<ClaimedTask> {
    let mut claimed = Vec::new();
    while let Some(task) = store.claim(worker, &Resources::default(), LONG).await.unwrap() {
        claimed.push(task);
    }
    claimed
}

/// Completes all tasks, also those that become free meanwhile.
async fn work_until(store: Store, worker: String, job: JobId) {
    while !store.job(job).await.unwrap().state.is_final() {
        match store.claim(&worker, &Resources::default(), LONG).await.unwrap() {
            Some(task) => store.complete(task.fence, None).await.unwrap(),
            None => tokio::time::sleep(Duration::from_millis(2)).await,
        }
    }
}

pub async fn every_task_is_claimed_once(f: Fixture) {
    f.submit_one(wide(1, 200)).await;
    let claimed =
        at_once(&f, |store, number| async move { claim_all(&store, &format!("w{number}")).await })
            .await;
    let fences: Vec<_> = claimed.iter().flatten().map(|task| task.fence).collect();
    let tasks: HashSet<_> = fences.iter().map(|fence| fence.task).collect();
    assert_eq!((fences.len(), tasks.len()), (200, 200));
    assert!(fences.iter().all(|fence| fence.epoch.0 == 1));
}

pub async fn tasks_of_many_jobs_are_claimed_once(f: Fixture) {
    for seed in 0..40 {
        f.submit_one(train(&simulate(seed), vec![])).await;
    }
    let claimed =
        at_once(
            &f,
            |store, number| async move { claim_all(&store, &format!("w{number}")).await.len() },
        )
        .await;
    assert_eq!(claimed.iter().sum::<usize>(), 40);
}

pub async fn pipelines_are_worked_off_to_their_ends(f: Fixture) {
    let mut pipelines = Vec::new();
    for seed in 0..4 {
        pipelines.push(f.submit(pipeline(seed)).await.job);
    }
    let last = pipelines[3];
    at_once(&f, move |store, number| work_until(store, format!("w{number}"), last)).await;
    f.work_off().await;
    assert_eq!(f.states(&pipelines).await, [JobState::Succeeded; 4]);
}

pub async fn the_last_tasks_of_a_job_end_together(f: Fixture) {
    for seed in 0..8 {
        let job = f.submit_one(wide(seed, 16)).await;
        let mut tasks = Vec::new();
        for _ in 0..CLIENTS {
            tasks.push(f.must_claim().await.fence);
        }
        at_once(&f, |store, number| {
            let fence = tasks[usize::try_from(number).unwrap()];
            async move { store.complete(fence, None).await.unwrap() }
        })
        .await;
        assert_eq!(f.state(job).await, JobState::Succeeded);
    }
}

/// A client that ends a task while others are queued leaves the job to the clients that end these.
pub async fn no_stage_and_no_job_is_left_open(f: Fixture) {
    let mut jobs = Vec::new();
    for seed in 0..60 {
        let mut job = evaluate(&simulate(seed), &simulate(1000 + seed), vec![]);
        job.tasks = (0..6).map(|n| task(n / 3, n % 3, 1)).collect();
        jobs.push(f.submit_one(job).await);
    }
    at_once(&f, |store, number| async move {
        let worker = format!("w{number}");
        while let Some(task) = store.claim(&worker, &Resources::default(), LONG).await.unwrap() {
            store.complete(task.fence, None).await.unwrap();
        }
    })
    .await;
    assert_eq!(f.states(&jobs).await, [JobState::Succeeded; 60]);
}

pub async fn a_stage_begins_once_whoever_ends_the_one_before(f: Fixture) {
    let mut job = evaluate(&simulate(1), &simulate(2), vec![]);
    job.tasks = (0..16).map(|cell| task(0, cell, 1)).chain([task(1, 0, 1)]).collect();
    f.submit_one(job).await;
    let mut tasks = Vec::new();
    for _ in 0..CLIENTS {
        tasks.push(f.must_claim().await.fence);
    }
    assert!(f.claim().await.is_none());
    at_once(&f, |store, number| {
        let fence = tasks[usize::try_from(number).unwrap()];
        async move { store.complete(fence, Some(&json!({"cell": number}))).await.unwrap() }
    })
    .await;
    let report = f.must_claim().await;
    assert_eq!((report.stage, report.fence.epoch.0), (1, 1));
    assert!(f.claim().await.is_none());
}

pub async fn the_last_shards_complete_their_dataset_together(f: Fixture) {
    for seed in 0..4 {
        let job = f.submit_one(simulate(seed)).await;
        let mut shards = Vec::new();
        for _ in 0..3 {
            let task = f.must_claim().await;
            let contents = f.publish_shard(&task).await;
            shards.push((task.fence, contents));
        }
        let commits = shards.into_iter().map(|(fence, contents)| {
            let store = f.store.clone();
            tokio::spawn(async move { store.commit_shard(fence, &contents, None).await.unwrap() })
        });
        for commit in commits.collect::<Vec<_>>() {
            commit.await.unwrap();
        }
        assert_eq!(f.state(job).await, JobState::Succeeded);
        let dataset = f.store.job(job).await.unwrap().dataset.unwrap();
        let dataset = f.store.dataset(dataset).await.unwrap();
        assert_eq!((dataset.state.as_str(), dataset.shards), ("complete", 3));
    }
}

pub async fn submissions_of_one_spec_make_one_job(f: Fixture) {
    let jobs = at_once(&f, |store, _| async move {
        store.submit(alone(train(&simulate(1), vec![]))).await.unwrap()
    })
    .await;
    let ids: HashSet<_> = jobs.iter().map(|submitted| submitted.job).collect();
    assert_eq!(ids.len(), 1);
    assert_eq!(jobs.iter().filter(|submitted| !submitted.reused).count(), 1);
}

pub async fn submissions_of_one_pipeline_make_one_pipeline(f: Fixture) {
    let jobs =
        at_once(&f, |store, _| async move { store.submit(pipeline(1)).await.unwrap().job }).await;
    assert_eq!(jobs.iter().collect::<HashSet<_>>().len(), 1);
    assert_eq!(f.members(jobs[0]).await.len(), 3);
}

pub async fn repeated_requests_make_one_job(f: Fixture) {
    let jobs = at_once(&f, |store, _| async move {
        let request = Digest::of(b"the request");
        let idempotency = Some(Idempotency { key: "k".to_owned(), request });
        let mut submission = alone(train(&simulate(1), vec![]));
        submission.reuse = store::Reuse::Never;
        store.submit(store::Submission { idempotency, ..submission }).await.unwrap().job
    })
    .await;
    assert_eq!(jobs.iter().collect::<HashSet<_>>().len(), 1);
}

pub async fn a_job_that_several_pipelines_share_is_done_once(f: Fixture) {
    let pipelines = at_once(&f, |store, number| async move {
        let simulation = simulate(7);
        let training = NewJob {
            digest: Digest::of(&number.to_le_bytes()),
            ..train(&simulation, vec![Need::New(0)])
        };
        store.submit(super::pipeline_of(vec![simulation, training])).await.unwrap().job
    })
    .await;
    let mut shared = HashSet::new();
    for pipeline in &pipelines {
        shared.insert(f.members(*pipeline).await[0]);
    }
    assert_eq!(shared.len(), 1);
    let shared: Vec<JobId> = shared.into_iter().collect();
    let memberships = f.store.memberships(&shared).await.unwrap();
    let mut newest_first = pipelines.clone();
    newest_first.sort_unstable_by_key(|pipeline| Reverse(*pipeline));
    assert_eq!(memberships.iter().map(|of| of.pipeline).collect::<Vec<_>>(), newest_first);
    assert!(memberships.iter().all(|of| of.job == shared[0] && !of.pipeline_name.is_empty()));
    let waiting = pipelines[0];
    at_once(&f, move |store, number| work_until(store, format!("w{number}"), waiting)).await;
    f.work_off().await;
    assert_eq!(f.states(&pipelines).await, [JobState::Succeeded; 16]);
}

pub async fn a_cancelled_job_leaves_no_task_that_does_not_know(f: Fixture) {
    for seed in 0..6 {
        let job = f.submit_one(wide(seed, 60)).await;
        let claimed = at_once(&f, move |store, number| async move {
            if number == 0 {
                tokio::time::sleep(Duration::from_millis(3)).await;
                store.cancel(job).await.unwrap();
                return Vec::new();
            }
            claim_all(&store, &format!("w{number}")).await
        })
        .await;
        for task in f.store.tasks(job).await.unwrap() {
            let knows = task.state == TaskState::Cancelled || task.cancel_requested;
            assert!(knows, "{} is {}", task.label, task.state);
        }
        for task in claimed.iter().flatten() {
            f.store.stopped(task.fence).await.unwrap();
        }
        assert_eq!(f.state(job).await, JobState::Cancelled);
    }
}

pub async fn nothing_is_claimed_after_a_pause_has_begun(f: Fixture) {
    f.submit_one(wide(1, 400)).await;
    f.must_claim().await;
    at_once(&f, |store, number| async move {
        if number == 0 {
            tokio::time::sleep(Duration::from_millis(10)).await;
            store.pause_queue().await.unwrap();
            let running = store.queue().await.unwrap().running;
            tokio::time::sleep(Duration::from_millis(50)).await;
            assert_eq!(store.queue().await.unwrap().running, running);
        } else {
            claim_all(&store, &format!("w{number}")).await;
        }
    })
    .await;
}

pub async fn a_dead_workers_task_is_taken_back_once(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let dead = f.claim_and_die().await;
    at_once(&f, |store, number| async move {
        if number % 2 == 0 {
            let mut reaper = Reaper::new(store, Duration::from_secs(1));
            reaper.look(Duration::ZERO).await.unwrap();
        } else {
            store.take_back("w0", WorkerEnd::Died("died")).await.unwrap();
        }
    })
    .await;
    let task = f.store.task(dead.fence.task).await.unwrap();
    assert_eq!((task.state, task.attempt), (TaskState::Queued, 1));
    assert_eq!(f.must_claim().await.attempt, 2);
}

pub async fn a_renewal_and_a_reaper_agree(f: Fixture) {
    for seed in 0..10 {
        f.submit_one(train(&simulate(seed), vec![])).await;
        let held = f.claim_and_die().await;
        let fence = held.fence;
        let kept = at_once(&f, move |store, number| async move {
            if number % 2 == 0 {
                let mut reaper = Reaper::new(store, Duration::from_secs(1));
                reaper.look(Duration::ZERO).await.unwrap();
                return None;
            }
            Some(store.renew(fence, LONG, &Progress::default()).await.unwrap())
        })
        .await;
        let last = f.store.renew(fence, LONG, &Progress::default()).await.unwrap();
        let task = f.store.task(fence.task).await.unwrap();
        if last == Lease::Lost {
            assert_eq!(task.state, TaskState::Queued);
            f.work_off().await;
        } else {
            assert_eq!((task.state, task.epoch), (TaskState::Running, fence.epoch));
            assert!(kept.iter().flatten().all(|lease| *lease != Lease::Lost));
            f.store.complete(fence, None).await.unwrap();
        }
    }
}

pub async fn of_two_endings_one_counts(f: Fixture) {
    for seed in 0..6 {
        f.submit_one(train(&simulate(seed), vec![])).await;
        let fence = f.must_claim().await.fence;
        let ended = at_once(&f, move |store, number| async move {
            match number % 4 {
                0 => store.complete(fence, None).await,
                1 => store.fail(fence, "no", Retry::Never).await,
                2 => store.release(fence).await,
                _ => store.fail(fence, "again", Retry::Allowed).await,
            }
        })
        .await;
        let counted = ended.iter().filter(|ending| ending.is_ok()).count();
        assert_eq!(counted, 1);
        for ending in ended {
            assert!(matches!(ending, Ok(()) | Err(StoreError::LeaseLost { .. })), "{ending:?}");
        }
        f.work_off().await;
    }
}

pub async fn only_the_holder_of_a_lease_records_metrics(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let zombie = f.claim_and_die().await;
    let (run, zombie) = (zombie.run.unwrap(), zombie.fence);
    f.reap().await;
    let holder = f.must_claim().await.fence;
    at_once(&f, move |store, number| async move {
        let (fence, value) = if number % 2 == 0 { (holder, 1.0) } else { (zombie, -1.0) };
        let points: Vec<Metric> =
            (0..20).map(|step| Metric { key: format!("k{number}"), step, value }).collect();
        let recorded = store.record_metrics(fence, &points).await;
        assert_eq!(recorded.is_ok(), number % 2 == 0);
    })
    .await;
    let latest = f.store.latest_metrics(&[run]).await.unwrap();
    assert_eq!(latest.len(), 8);
    assert!(latest.iter().all(|(_, _, point)| point.value > 0.0));
}

pub async fn heartbeats_metrics_and_endings_wait_for_nobody_for_ever(f: Fixture) {
    for seed in 0..16 {
        f.submit_one(train(&simulate(seed), vec![])).await;
    }
    let mut fences = Vec::new();
    for _ in 0..CLIENTS {
        fences.push(f.must_claim().await.fence);
    }
    let work = at_once(&f, |store, number| {
        let fence = fences[usize::try_from(number).unwrap()];
        async move {
            for step in 0..20 {
                store.renew(fence, LONG, &Progress::default()).await.unwrap();
                let point = Metric { key: "loss".to_owned(), step, value: 1.0 };
                store.record_metrics(fence, &[point]).await.unwrap();
            }
            store.submit(alone(simulate(100 + number))).await.unwrap();
            store.complete(fence, None).await.unwrap();
        }
    });
    tokio::time::timeout(Duration::from_secs(60), work).await.unwrap();
}

pub async fn one_file_that_all_send_is_one_upload(f: Fixture) {
    let uploads = at_once(&f, |store, _| async move {
        let mut upload = store.begin_upload().await.unwrap();
        upload.write(b"time,u,y\n").await.unwrap();
        upload.finish("arm.csv").await.unwrap()
    })
    .await;
    let digests: HashSet<_> = uploads.iter().map(|upload| upload.object.sha256).collect();
    assert_eq!(digests.len(), 1);
    assert_eq!(f.store.newest_uploads(100).await.unwrap().len(), 1);
    let found = f.store.upload(uploads[0].object.sha256).await.unwrap().unwrap();
    f.store.read_object(&found.object).await.unwrap();
}

pub async fn all_workers_register_and_leave(f: Fixture) {
    let workers = at_once(&f, |store, number| async move {
        let worker = super::workers::worker(&format!("w{number:02}"), 1);
        store.register_worker(&worker).await.unwrap();
        store.see_worker(&worker, None).await.unwrap();
        worker
    })
    .await;
    assert_eq!(f.store.workers().await.unwrap().len(), 16);
    at_once(&f, |store, number| {
        let worker = workers[usize::try_from(number).unwrap()].clone();
        async move { store.forget_worker(&worker).await.unwrap() }
    })
    .await;
    assert!(f.store.workers().await.unwrap().is_empty());
}

pub async fn a_zombie_and_the_holder_commit_one_shard(f: Fixture) {
    for seed in 0..4 {
        f.submit_one(wide(seed, 1)).await;
        let zombie = f.claim_and_die().await;
        f.reap().await;
        let holder = f.must_claim().await;
        let mut shards: Vec<(store::Fence, ShardContents)> = Vec::new();
        for task in [&zombie, &holder] {
            shards.push((task.fence, f.publish_shard(task).await));
        }
        at_once(&f, |store, number| {
            let (fence, contents) = shards[usize::try_from(number % 2).unwrap()].clone();
            async move {
                let committed = store.commit_shard(fence, &contents, None).await;
                assert_eq!(committed.is_ok(), number % 2 == 1, "{committed:?}");
            }
        })
        .await;
        let dataset = f.store.job(holder.job).await.unwrap().dataset.unwrap();
        let shards = f.store.shards(dataset).await.unwrap();
        let epoch = holder.fence.epoch;
        let path = object_path::shard(holder.job, 0, epoch, FileContent::Trajectories);
        assert_eq!((shards.len(), &shards[0].contents.trajectories.path), (1, &path));
    }
}

/// Sixteen clients do random operations. The final states must still follow the rules.
pub async fn whatever_happens_jobs_and_tasks_agree(f: Fixture) {
    at_once(&f, |store, number| async move {
        let worker = format!("w{number}");
        let mut dice = number.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        let mut jobs = Vec::new();
        let mut held: Vec<ClaimedTask> = Vec::new();
        for step in 0..60_u64 {
            dice ^= dice << 13;
            dice ^= dice >> 7;
            dice ^= dice << 17;
            match dice % 8 {
                0 => {
                    jobs.push(store.submit(alone(wide(number * 1000 + step, 3))).await.unwrap().job)
                }
                1 => jobs.push(store.submit(pipeline(dice % 5)).await.unwrap().job),
                2 if !jobs.is_empty() => store.cancel(jobs.swap_remove(0)).await.unwrap(),
                3..=5 => {
                    held.extend(store.claim(&worker, &Resources::default(), LONG).await.unwrap())
                }
                _ => {
                    let Some(task) = held.pop() else { continue };
                    let ended = match dice % 5 {
                        0 => store.fail(task.fence, "no", Retry::Allowed).await,
                        1 => store.fail(task.fence, "never", Retry::Never).await,
                        2 => store.release(task.fence).await,
                        3 => store.stopped(task.fence).await,
                        _ => store.complete(task.fence, None).await,
                    };
                    assert!(matches!(ended, Ok(()) | Err(StoreError::LeaseLost { .. })));
                }
            }
        }
    })
    .await;
    let mut page = Page { limit: 500, ..Page::default() };
    loop {
        let jobs = f.store.jobs(store::JobFilter::default(), page).await.unwrap();
        let Some(last) = jobs.last() else { break };
        page.before = Some(last.id.0);
        for job in jobs.iter().filter(|job| job.kind != "pipeline") {
            agrees(&f, job).await;
        }
    }
}

/// Checks that the state of a job follows from those of its tasks.
async fn agrees(f: &Fixture, job: &store::Job) {
    let tasks = f.store.tasks(job.id).await.unwrap();
    let any = |state| tasks.iter().any(|task| task.state == state);
    let is_open = any(TaskState::Queued) || any(TaskState::Running) || any(TaskState::Waiting);
    let ending = |task: &store::Task| task.state != TaskState::Running || task.cancel_requested;
    let fits = match job.state {
        JobState::Waiting => tasks.iter().all(|task| task.state == TaskState::Waiting),
        JobState::Queued => any(TaskState::Queued) && !any(TaskState::Running),
        JobState::Running => is_open,
        JobState::Succeeded => tasks.iter().all(|task| task.state == TaskState::Succeeded),
        JobState::Failed => any(TaskState::Failed) && tasks.iter().all(ending),
        JobState::Cancelled => tasks.iter().all(ending) && !any(TaskState::Queued),
    };
    let states: Vec<_> = tasks.iter().map(|task| task.state.as_str()).collect();
    assert!(fits, "job {} is {} with tasks {states:?}", job.id, job.state);
}
