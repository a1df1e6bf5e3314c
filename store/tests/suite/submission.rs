use serde_json::json;
use spec::Digest;
use store::{
    Idempotency, JobFilter, JobState, Need, Page, Retry, Reuse, StoreError, Submission, Submitted,
    TaskState,
};

use super::{Fixture, alone, digest_of, evaluate, pipeline, simulate, train, verify};

pub async fn a_job_that_was_done_is_not_done_again(f: Fixture) {
    let first = f.submit(alone(simulate(1))).await;
    assert!(!first.reused);
    let again = Submitted { reused: true, ..first.clone() };
    assert_eq!(f.submit(alone(simulate(1))).await, again, "while queued");
    f.work_off().await;
    assert_eq!(f.submit(alone(simulate(1))).await, again, "when succeeded");
    assert_ne!(f.submit(alone(simulate(2))).await.job, first.job);
}

pub async fn execution_does_not_tell_jobs_apart(f: Fixture) {
    let first = f.submit_one(simulate(1)).await;
    let again = f.submit(alone(super::with_execution(simulate(1), 7, 1))).await;
    assert_eq!(again, Submitted { job: first, reused: true });
}

pub async fn a_job_that_says_what_is_the_case_is_done_every_time(f: Fixture) {
    let data = f.submit_one(simulate(1)).await;
    let dataset = f.store.job(data).await.unwrap().dataset.unwrap();
    assert!(f.store.newest_reader(dataset, "verify").await.unwrap().is_none());
    let first = f.submit_one(verify(data)).await;
    let second = f.submit(alone(verify(data))).await;
    assert!(second.job != first && !second.reused);
    let newest = f.store.newest_reader(dataset, "verify").await.unwrap().unwrap();
    assert_eq!(newest.id, second.job);
    assert!(f.store.newest_reader(dataset, "train").await.unwrap().is_none());
}

pub async fn a_job_that_failed_is_done_again(f: Fixture) {
    let first = f.submit_one(simulate(1)).await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, "no", Retry::Never).await.unwrap();
    let second = f.submit(alone(simulate(1))).await;
    assert!(second.job != first && !second.reused);
}

/// The second of two cells fails. The report follows both.
pub async fn an_evaluation_takes_over_the_cells_of_one_that_failed(f: Fixture) {
    let evaluation = || evaluate(&simulate(1), &train(&simulate(1), vec![]), vec![]);
    f.submit_one(evaluation()).await;
    let made = json!({"made": "by the first"});
    let first = f.must_claim().await;
    f.store.complete(first.fence, Some(&made)).await.unwrap();
    let second = f.must_claim().await;
    f.store.fail(second.fence, "no", Retry::Never).await.unwrap();

    let again = f.submit_one(evaluation()).await;
    let tasks = f.store.tasks(again).await.unwrap();
    let states: Vec<TaskState> = tasks.iter().map(|task| task.state).collect();
    assert_eq!(states, [TaskState::Succeeded, TaskState::Queued, TaskState::Waiting]);
    assert_eq!((tasks[0].result.as_ref(), tasks[0].attempt), (Some(&made), 0));
    assert_eq!(f.work_off().await.len(), 2);
    assert_eq!(f.state(again).await, JobState::Succeeded);

    let forced = Submission { reuse: Reuse::Never, ..alone(evaluation()) };
    f.submit(forced).await;
    assert_eq!(f.work_off().await.len(), 3);
}

/// Only the last stage is left to do.
pub async fn an_evaluation_that_lacks_its_report_alone_begins_with_it(f: Fixture) {
    let evaluation = || evaluate(&simulate(1), &train(&simulate(1), vec![]), vec![]);
    let first = f.submit_one(evaluation()).await;
    for _ in 0..2 {
        let cell = f.must_claim().await;
        f.store.complete(cell.fence, Some(&json!({}))).await.unwrap();
    }
    f.store.cancel(first).await.unwrap();
    let again = f.submit_one(evaluation()).await;
    let done = f.work_off().await;
    let stages: Vec<u32> = done.iter().map(|task| task.stage).collect();
    assert_eq!(stages, [1]);
    assert_eq!(f.state(again).await, JobState::Succeeded);
}

pub async fn a_job_that_is_being_cancelled_is_not_reused(f: Fixture) {
    let first = f.submit_one(simulate(1)).await;
    f.must_claim().await;
    f.store.cancel(first).await.unwrap();
    assert_eq!(f.state(first).await, JobState::Running);
    assert_ne!(f.submit_one(simulate(1)).await, first);
}

pub async fn force_computes_anew_and_needs_point_to_the_new_jobs(f: Fixture) {
    let first = f.submit(pipeline(1)).await;
    let old = f.members(first.job).await;
    f.work_off().await;
    let forced = Submission { reuse: Reuse::Never, ..pipeline(1) };
    let second = f.submit(forced).await;
    let new = f.members(second.job).await;
    assert!(!second.reused && second.job != first.job);
    assert!(new.iter().all(|job| !old.contains(job)));
    assert_eq!(f.store.needs(&[new[1]]).await.unwrap(), [(new[1], new[0])]);
    assert_eq!(f.state(new[1]).await, JobState::Waiting);
    assert!(f.store.members(&[second.job]).await.unwrap().iter().all(|member| !member.reused));
}

pub async fn a_job_uses_what_it_needs_and_what_it_reads_by_digest(f: Fixture) {
    let data = simulate(1);
    let simulation = f.submit_one(data.clone()).await;
    let trained = train(&data, vec![Need::Existing(simulation)]);
    let first = f.submit_one(trained.clone()).await;
    f.work_off().await;
    let forced = Submission { reuse: Reuse::Never, ..Submission::of(trained.clone()) };
    let second = f.submit(forced).await.job;
    f.work_off().await;
    // The checkpoint exists, so the evaluation needs the data alone.
    let asked = f.submit_one(evaluate(&data, &trained, vec![Need::Existing(simulation)])).await;
    let third = Submission { reuse: Reuse::Never, ..Submission::of(trained.clone()) };
    let third = f.submit(third).await.job;
    assert_eq!(f.store.needs(&[asked]).await.unwrap(), [(asked, simulation)]);
    let sources = f.store.sources(&[asked]).await.unwrap();
    assert_eq!(sources, [(asked, simulation), (asked, second)]);
    assert_eq!(f.store.users(&[second]).await.unwrap(), [(asked, second)]);
    assert_eq!(f.store.users(&[first, third]).await.unwrap(), []);
    let users = f.store.users(&[simulation]).await.unwrap();
    assert_eq!(users, [third, asked, second, first].map(|user| (user, simulation)));
    // A training that is needed is no source twice.
    let needs = vec![Need::Existing(simulation), Need::Existing(first)];
    let waiting = f.submit_one(evaluate(&simulate(2), &trained, needs)).await;
    let sources = f.store.sources(&[waiting]).await.unwrap();
    assert_eq!(sources, [(waiting, simulation), (waiting, first)]);
}

pub async fn a_pipeline_is_reused_whole_or_job_by_job(f: Fixture) {
    let simulation = f.submit_one(simulate(1)).await;
    f.work_off().await;
    let first = f.submit(pipeline(1)).await;
    let members = f.store.members(&[first.job]).await.unwrap();
    assert_eq!((members[0].job, members[0].reused), (simulation, true));
    assert_eq!((members[1].state, members[1].reused), (JobState::Queued, false));
    assert_eq!(f.submit(pipeline(1)).await, Submitted { job: first.job, reused: true });
    f.work_off().await;

    // The same jobs under another name are another pipeline, which has nothing left to do.
    let mut renamed = pipeline(1);
    renamed.pipeline.as_mut().unwrap().job.digest = Digest::of(b"renamed");
    let second = f.submit(renamed).await;
    assert!(!second.reused);
    assert_eq!(f.state(second.job).await, JobState::Succeeded);
}

pub async fn a_pipeline_that_can_only_fail_is_not_reused(f: Fixture) {
    let mut other = simulate(2);
    other.name = "other".into();
    let submission = super::pipeline_of(vec![simulate(1), other]);
    let first = f.submit(submission.clone()).await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, "no", Retry::Never).await.unwrap();
    assert_eq!(f.state(first.job).await, JobState::Running);
    let second = f.submit(submission).await;
    assert!(second.job != first.job && !second.reused);
    let members = f.store.members(&[second.job]).await.unwrap();
    assert_eq!(members.iter().map(|m| m.reused).collect::<Vec<_>>(), [false, true]);
}

pub async fn a_submission_that_is_dropped_halfway_leaves_nothing(f: Fixture) {
    for microseconds in (0..4000).step_by(50) {
        let (store, seed) = (f.store.clone(), microseconds);
        let submission = tokio::spawn(async move { store.submit(pipeline(seed)).await });
        tokio::time::sleep(std::time::Duration::from_micros(microseconds)).await;
        submission.abort();
    }
    f.submit(pipeline(9999)).await;
    let page = Page { before: None, limit: 500 };
    let kind = Some("pipeline");
    let pipelines = f.store.jobs(JobFilter { kind, state: None }, page).await.unwrap();
    for pipeline in &pipelines {
        assert_eq!(f.members(pipeline.id).await.len(), 3);
    }
    let all = f.store.jobs(JobFilter::default(), page).await.unwrap();
    assert_eq!(all.len(), 4 * pipelines.len());
    assert_eq!(f.work_off().await.len(), 7 * pipelines.len());
}

pub async fn a_repeated_request_does_what_the_first_did(f: Fixture) {
    let with_key = |seed: u64| Submission {
        idempotency: Some(Idempotency {
            key: "k".into(),
            request: Digest::of(&seed.to_be_bytes()),
        }),
        reuse: Reuse::Never,
        ..alone(simulate(seed))
    };
    let key = |seed| with_key(seed).idempotency.unwrap();
    assert_eq!(f.store.repeated(&key(1)).await.unwrap(), None);
    let first = f.submit(with_key(1)).await;
    assert_eq!(f.submit(with_key(1)).await, first);
    assert_eq!(f.store.repeated(&key(1)).await.unwrap(), Some(first.clone()));
    assert!(!first.reused);
    let error = f.store.repeated(&key(2)).await.unwrap_err();
    assert!(matches!(error, StoreError::IdempotencyConflict { .. }), "{error}");
    let error = f.store.submit(with_key(2)).await.unwrap_err();
    assert!(matches!(error, StoreError::IdempotencyConflict { .. }), "{error}");
    assert_eq!(f.store.jobs(JobFilter::default(), Page::default()).await.unwrap().len(), 1);
}

pub async fn an_inconsistent_submission_leaves_nothing(f: Fixture) {
    let mut backwards = pipeline(1);
    backwards.jobs[0].needs = vec![Need::New(1)];
    let mut empty = alone(simulate(1));
    empty.jobs[0].tasks.clear();
    let two = Submission { pipeline: None, ..pipeline(1) };
    for submission in [backwards, empty, two] {
        let error = f.store.submit(submission).await.unwrap_err();
        assert!(matches!(error, StoreError::InvalidSubmission { .. }), "{error}");
    }
    let missing = alone(train(&simulate(1), vec![Need::Existing(store::JobId(77))]));
    let error = f.store.submit(missing).await.unwrap_err();
    assert_eq!(error.to_string(), "there is no job 77");
    assert!(f.store.jobs(JobFilter::default(), Page::default()).await.unwrap().is_empty());
}

pub async fn jobs_are_listed_newest_first_in_pages(f: Fixture) {
    let mut ids = Vec::new();
    for seed in 0..5 {
        ids.push(f.submit_one(simulate(seed)).await);
    }
    ids.reverse();
    let page = Page { before: None, limit: 2 };
    let first = f.store.jobs(JobFilter::default(), page).await.unwrap();
    assert_eq!(first.iter().map(|job| job.id).collect::<Vec<_>>(), ids[..2]);
    let next = Page { before: Some(first[1].id.0), limit: 500 };
    let rest = f.store.jobs(JobFilter::default(), next).await.unwrap();
    assert_eq!(rest.iter().map(|job| job.id).collect::<Vec<_>>(), ids[2..]);
}

pub async fn experiments_are_what_somebody_asked_for(f: Fixture) {
    let alone = f.submit_one(simulate(1)).await;
    let mut pipelines = Vec::new();
    for seed in 1..40 {
        pipelines.push(f.submit(pipeline(seed)).await.job);
    }
    // The first pipeline has the existing job. The others made all of theirs.
    pipelines.reverse();
    let page = Page { before: None, limit: 30 };
    let first = f.store.experiments(None, page).await.unwrap();
    assert_eq!(first.iter().map(|job| job.id).collect::<Vec<_>>(), pipelines[..30]);
    let page = Page { before: Some(first[29].id.0), limit: 30 };
    let rest = f.store.experiments(None, page).await.unwrap();
    let expected = [&pipelines[30..], &[alone][..]].concat();
    assert_eq!(rest.iter().map(|job| job.id).collect::<Vec<_>>(), expected);
    f.store.cancel(pipelines[5]).await.unwrap();
    let cancelled = f.store.experiments(Some(JobState::Cancelled), Page::default()).await.unwrap();
    assert_eq!(cancelled.iter().map(|job| job.id).collect::<Vec<_>>(), [pipelines[5]]);
}

pub async fn jobs_are_filtered_by_kind_and_state(f: Fixture) {
    f.submit(pipeline(1)).await;
    let found = |kind, state| {
        let store = f.store.clone();
        async move {
            let jobs = store.jobs(JobFilter { kind, state }, Page::default()).await.unwrap();
            jobs.into_iter().map(|job| job.kind).collect::<Vec<_>>()
        }
    };
    assert_eq!(found(None, None).await.len(), 4);
    assert_eq!(found(Some("train"), None).await, ["train"]);
    assert_eq!(found(None, Some(JobState::Queued)).await, ["pipeline", "simulate"]);
    assert!(found(Some("train"), Some(JobState::Queued)).await.is_empty());
}

pub async fn a_job_is_found_by_its_digest(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let digest = digest_of(&simulate(1));
    let found = f.store.job_by_digest(digest, &JobState::ALL).await.unwrap().unwrap();
    assert_eq!((found.id, found.spec), (job, simulate(1).spec));
    assert!(f.store.job_by_digest(digest, &[JobState::Failed]).await.unwrap().is_none());
    assert!(f.store.job_by_digest(digest, &[]).await.unwrap().is_none());
}

pub async fn what_does_not_exist_is_named(f: Fixture) {
    let job = store::JobId(5);
    assert_eq!(f.store.job(job).await.unwrap_err().to_string(), "there is no job 5");
    assert_eq!(f.store.tasks(job).await.unwrap_err().to_string(), "there is no job 5");
    assert_eq!(f.store.cancel(job).await.unwrap_err().to_string(), "there is no job 5");
    let simulation = f.submit_one(simulate(1)).await;
    let error = f.store.run_of_job(simulation).await.unwrap_err();
    assert_eq!(error.to_string(), format!("there is no run of job {simulation}"));
    assert_eq!(f.store.job(simulation).await.unwrap().spec["seed"], json!(1));
}
