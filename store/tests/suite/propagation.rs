use store::{JobState, Need, Retry, TaskState};

use super::{Fixture, alone, evaluate, pipeline, pipeline_of, simulate, train};

pub async fn a_stage_waits_for_all_tasks_of_the_stage_before(f: Fixture) {
    let data = simulate(1);
    let job = f.submit_one(evaluate(&data, &train(&data, vec![]), vec![])).await;
    let (first, second) = (f.must_claim().await, f.must_claim().await);
    assert_eq!((first.stage, second.stage), (0, 0));
    assert!(f.claim().await.is_none());
    f.store.complete(first.fence, None).await.unwrap();
    assert!(f.claim().await.is_none());
    f.store.complete(second.fence, None).await.unwrap();
    let report = f.must_claim().await;
    assert_eq!(report.stage, 1);
    assert_eq!(f.state(job).await, JobState::Running);
    f.store.complete(report.fence, None).await.unwrap();
    assert_eq!(f.state(job).await, JobState::Succeeded);
}

pub async fn a_pipeline_runs_its_jobs_in_the_order_of_their_needs(f: Fixture) {
    let submitted = f.submit(pipeline(1)).await;
    let members = f.members(submitted.job).await;
    assert_eq!(f.state(submitted.job).await, JobState::Queued);
    use JobState::{Queued, Succeeded, Waiting};
    assert_eq!(f.states(&members).await, [Queued, Waiting, Waiting]);
    let needs = f.store.needs(&members).await.unwrap();
    let expected = [(1, 0), (2, 0), (2, 1)].map(|(job, need)| (members[job], members[need]));
    assert_eq!(needs, expected);

    let task = f.must_claim().await;
    assert_eq!(f.state(submitted.job).await, JobState::Running);
    f.store.complete(task.fence, None).await.unwrap();
    let order: Vec<_> = f.work_off().await.iter().map(|task| task.job).collect();
    let [simulation, training, evaluation] = members[..] else { panic!("not three members") };
    let expected = [simulation, simulation, training, evaluation, evaluation, evaluation];
    assert_eq!(order, expected);
    assert_eq!(f.states(&members).await, [Succeeded; 3]);
    let pipeline = f.store.job(submitted.job).await.unwrap();
    assert_eq!(pipeline.state, Succeeded);
    assert!(pipeline.started_at.is_some() && pipeline.finished_at >= pipeline.started_at);
    assert_eq!((pipeline.progress.done, pipeline.progress.total), (3, 3));
    assert_eq!(pipeline.progress.unit, "jobs");
}

pub async fn a_failed_job_cancels_those_that_need_it_and_fails_its_pipeline(f: Fixture) {
    let submitted = f.submit(pipeline(1)).await;
    let members = f.members(submitted.job).await;
    let (failing, other) = (f.must_claim().await, f.must_claim().await);
    f.store.fail(failing.fence, "no robot survived", Retry::Never).await.unwrap();

    use JobState::{Cancelled, Failed};
    assert_eq!(f.states(&members).await, [Failed, Cancelled, Cancelled]);
    assert_eq!(f.error(members[1]).await, format!("needs job {}, which failed", members[0]));
    assert_eq!(f.error(members[2]).await, format!("needs job {}, which failed", members[0]));
    assert_eq!(f.state(submitted.job).await, Failed);
    let error = f.error(submitted.job).await;
    assert_eq!(
        error,
        format!("train-set (job {}) failed: piece 0.0: no robot survived", members[0])
    );
    assert!(f.claim().await.is_none());
    assert!(f.store.task(other.fence.task).await.unwrap().cancel_requested);

    // Running tasks end without changing final states.
    f.store.complete(other.fence, None).await.unwrap();
    assert_eq!(f.states(&members).await, [Failed, Cancelled, Cancelled]);
    let states: Vec<_> =
        f.store.tasks(members[0]).await.unwrap().iter().map(|task| task.state).collect();
    assert_eq!(states, [TaskState::Failed, TaskState::Succeeded, TaskState::Cancelled]);
}

pub async fn a_pipeline_ends_when_its_last_member_does(f: Fixture) {
    let submitted = f
        .submit(pipeline_of(vec![simulate(1), {
            let mut other = simulate(2);
            other.name = "other".into();
            other
        }]))
        .await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, "no", Retry::Never).await.unwrap();
    assert_eq!(f.state(submitted.job).await, JobState::Running);
    f.work_off().await;
    assert_eq!(f.state(submitted.job).await, JobState::Failed);
}

pub async fn a_job_waits_for_one_that_was_submitted_before(f: Fixture) {
    let data = simulate(1);
    let simulation = f.submit_one(data.clone()).await;
    let training = f.submit_one(train(&data, vec![Need::Existing(simulation)])).await;
    assert_eq!(f.state(training).await, JobState::Waiting);
    f.work_off().await;
    assert_eq!(f.state(training).await, JobState::Succeeded);

    let failing = f.submit_one(simulate(2)).await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, "no", Retry::Never).await.unwrap();
    let late = train(&simulate(2), vec![Need::Existing(failing)]);
    let error = f.store.submit(alone(late)).await.unwrap_err();
    assert_eq!(error.to_string(), format!("needs job {failing}, which is failed"));
}
