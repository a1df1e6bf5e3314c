use serde_json::{Value, json};
use store::{JobId, Store, TaskId, TaskPage};

use super::{Fixture, alone, evaluate, pipeline, simulate, task, train};

async fn page(store: &Store, job: JobId, after: Option<TaskId>, limit: u32) -> Vec<String> {
    let tasks = store.task_page(job, TaskPage { after, limit }).await.unwrap();
    tasks.into_iter().map(|task| task.label).collect()
}

/// Caught: all tasks of a job were read with their results to show some of them.
pub async fn tasks_are_read_in_pages_in_the_order_in_which_they_run(f: Fixture) {
    let mut job = evaluate(&simulate(1), &train(&simulate(1), vec![]), vec![]);
    // The tasks are not in the order of their ids.
    job.tasks = vec![task(1, 0, 1), task(0, 1, 1), task(0, 0, 1)];
    let job = f.submit_one(job).await;
    let other = f.submit_one(simulate(2)).await;
    let all = f.store.tasks(job).await.unwrap();
    let labels: Vec<String> = all.iter().map(|task| task.label.clone()).collect();
    assert_eq!(labels, ["piece 0.0", "piece 0.1", "piece 1.0"]);
    assert_eq!(page(&f.store, job, None, 500).await, labels);
    assert_eq!(page(&f.store, job, None, 2).await, labels[..2]);
    assert_eq!(page(&f.store, job, Some(all[0].id), 1).await, labels[1..2]);
    assert_eq!(page(&f.store, job, Some(all[1].id), 500).await, labels[2..]);
    for after in [all[2].id, f.store.tasks(other).await.unwrap()[0].id, TaskId(77)] {
        assert!(page(&f.store, job, Some(after), 500).await.is_empty());
    }
    assert_eq!(f.store.count_tasks(job).await.unwrap(), 3);
    let first = f.store.first_tasks(job, 2).await.unwrap();
    assert_eq!(first.iter().map(|task| task.id).collect::<Vec<_>>(), [all[0].id, all[1].id]);
}

/// Two simulations with three tasks each. The first simulation has ended with results.
async fn with_results(f: &Fixture, results: [Value; 3]) -> [JobId; 2] {
    let jobs = [f.submit(alone(simulate(1))).await.job, f.submit(alone(simulate(2))).await.job];
    for result in results {
        let task = f.must_claim().await;
        f.store.complete(task.fence, Some(&result)).await.unwrap();
    }
    jobs
}

pub async fn results_are_counted_by_the_value_of_a_field(f: Fixture) {
    let results = [json!({"bytes": "equal"}), json!({"bytes": "equal"}), json!({"bytes": 7})];
    let [first, second] = with_results(&f, results).await;
    let tallies = f.store.result_tallies(&[first, second], "bytes").await.unwrap();
    let mut found: Vec<_> = tallies
        .into_iter()
        .map(|tally| (tally.job, tally.value.unwrap_or_default(), tally.tasks))
        .collect();
    found.sort();
    let expected =
        [(first, "7".to_owned(), 1), (first, "equal".to_owned(), 2), (second, String::new(), 3)];
    assert_eq!(found, expected);
    let unlike = f.store.results_unlike(first, "bytes", "equal", 5).await.unwrap();
    assert_eq!(unlike, [("piece 0.2".to_owned(), json!({"bytes": 7}))]);
    assert!(f.store.results_unlike(second, "bytes", "equal", 5).await.unwrap().is_empty());
}

pub async fn the_only_task_of_the_last_stage_speaks_for_its_job(f: Fixture) {
    let several = with_results(&f, [json!(1), json!(2), json!(3)]).await;
    let made = evaluate(&simulate(1), &train(&simulate(1), vec![]), vec![]);
    let evaluation = f.submit_one(made).await;
    let jobs = [several[0], several[1], evaluation];
    assert!(f.store.sole_results(&jobs).await.unwrap().is_empty());
    let mut stage = 0;
    while let Some(task) = f.claim().await {
        stage = task.stage;
        f.store.complete(task.fence, Some(&json!({"stage": stage}))).await.unwrap();
    }
    assert_eq!(stage, 1);
    let expected = [(evaluation, json!({"stage": 1}))];
    assert_eq!(f.store.sole_results(&jobs).await.unwrap(), expected);
}

pub async fn what_belongs_to_several_jobs_is_read_at_once(f: Fixture) {
    let pipelines = [f.submit(pipeline(1)).await.job, f.submit(pipeline(2)).await.job];
    let members = f.store.members(&pipelines).await.unwrap();
    let owners: Vec<JobId> = members.iter().map(|member| member.pipeline).collect();
    assert_eq!(owners, [[pipelines[0]; 3], [pipelines[1]; 3]].concat());
    assert_eq!((members[3].progress.total, members[3].progress.unit.as_str()), (6, "trajectories"));
    let jobs: Vec<JobId> = members.iter().map(|member| member.job).collect();
    assert!(f.store.members(&jobs).await.unwrap().is_empty());

    let rows = f.store.jobs_by_id(&[jobs[4], jobs[0], JobId(77)]).await.unwrap();
    assert_eq!(rows.iter().map(|job| job.id).collect::<Vec<_>>(), [jobs[0], jobs[4]]);
    let specs = f.store.specs(&jobs[..1]).await.unwrap();
    assert_eq!(specs, [(jobs[0], rows[0].spec.clone())]);
    let newest = f.store.newest_specs(&[rows[0].digest, rows[1].digest]).await.unwrap();
    assert_eq!(newest.len(), 2);
    let datasets = f.store.datasets_of_jobs(&jobs).await.unwrap();
    assert_eq!(datasets.iter().map(|row| row.0).collect::<Vec<_>>(), [jobs[0], jobs[3]]);
    let ids = [datasets[1].1, datasets[0].1];
    let found = f.store.datasets_by_id(&ids).await.unwrap();
    assert_eq!(found.iter().map(|dataset| dataset.job).collect::<Vec<_>>(), [jobs[0], jobs[3]]);
    let cells = f.store.tasks_of_stage(&[jobs[2], jobs[5]], 0).await.unwrap();
    let cells: Vec<(JobId, &str)> =
        cells.iter().map(|task| (task.job, task.label.as_str())).collect();
    let expected = [
        (jobs[2], "piece 0.0"),
        (jobs[2], "piece 0.1"),
        (jobs[5], "piece 0.0"),
        (jobs[5], "piece 0.1"),
    ];
    assert_eq!(cells, expected);
}
