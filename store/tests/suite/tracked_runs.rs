use std::time::Duration;

use store::{
    ExperimentId, NewTrackedRun, StoreError, Timestamp, TrackedBatch, TrackedMetric, TrackedRun,
    TrackedRunChange, TrackedStatus,
};

use super::{Fixture, LONG};

async fn created(f: &Fixture, experiment: ExperimentId) -> TrackedRun {
    let new = NewTrackedRun {
        experiment,
        name: None,
        user: "ada".to_owned(),
        start_time: Timestamp::from_milliseconds(1_700_000_000_123),
        tags: vec![pair("note", "first")],
    };
    f.store.create_tracked_run(&new).await.unwrap()
}

fn pair(key: &str, value: &str) -> (String, String) {
    (key.to_owned(), value.to_owned())
}

fn point(key: &str, step: i64, time: i64, value: f64) -> TrackedMetric {
    TrackedMetric { key: key.to_owned(), step, time: Timestamp::from_milliseconds(time), value }
}

fn metrics(metrics: Vec<TrackedMetric>) -> TrackedBatch {
    TrackedBatch { metrics, ..TrackedBatch::default() }
}

fn params(params: Vec<(String, String)>) -> TrackedBatch {
    TrackedBatch { params, ..TrackedBatch::default() }
}

async fn latest(f: &Fixture, run: &TrackedRun) -> Vec<TrackedMetric> {
    let latest = f.store.latest_tracked(&[run.id], None).await.unwrap();
    latest.into_iter().map(|(_, metric)| metric).collect()
}

async fn values(f: &Fixture, run: &TrackedRun, key: &str) -> Vec<f64> {
    let points = f.store.tracked_history(run.id, key, 0, 10_000).await.unwrap();
    points.into_iter().map(|point| point.value).collect()
}

/// The params of a run, and its tags.
async fn texts(f: &Fixture, run: &TrackedRun) -> [Vec<(String, String)>; 2] {
    let params = f.store.tracked_params(&[run.id], None).await.unwrap();
    let tags = f.store.tracked_tags(&[run.id], None).await.unwrap();
    [params, tags].map(|rows| rows.into_iter().map(|(_, key, value)| (key, value)).collect())
}

pub async fn two_experiments_are_there_from_the_start(f: Fixture) {
    let experiments = f.store.tracked_experiments().await.unwrap();
    let named: Vec<_> =
        experiments.iter().map(|experiment| (experiment.id, experiment.name.as_str())).collect();
    assert_eq!(named, [(ExperimentId::DEFAULT, "Default"), (ExperimentId::TORQUED, "torqued")]);
    let tags = [pair("team", "arms")];
    let id = f.store.create_experiment("robots", &tags).await.unwrap();
    assert_eq!(id, ExperimentId(2));
    let found = f.store.experiment_named("robots").await.unwrap();
    assert_eq!((found.id, found.tags.into_iter().collect::<Vec<_>>()), (id, tags.to_vec()));
}

pub async fn a_name_of_an_experiment_is_given_once(f: Fixture) {
    let id = f.store.create_experiment("robots", &[]).await.unwrap();
    f.store.set_experiment_deleted(id, Some(LONG)).await.unwrap();
    let again = f.store.create_experiment("robots", &[]).await.unwrap_err();
    assert!(matches!(again, StoreError::ExperimentTaken { .. }), "{again}");
    let renamed = f.store.rename_experiment(ExperimentId::DEFAULT, "robots").await.unwrap_err();
    assert!(matches!(renamed, StoreError::ExperimentTaken { .. }), "{renamed}");
    f.store.rename_experiment(id, "robots").await.unwrap();
    f.store.rename_experiment(id, "arms").await.unwrap();
    f.store.create_experiment("robots", &[]).await.unwrap();
}

pub async fn a_run_keeps_what_its_client_said(f: Fixture) {
    let run = created(&f, ExperimentId::DEFAULT).await;
    assert_eq!(run.identifier.len(), 32);
    assert_eq!(run.name, format!("run-{}", &run.identifier[..8]));
    assert_eq!(run.start_time.milliseconds(), 1_700_000_000_123);
    let end_time = Some(Timestamp::from_milliseconds(i64::MAX));
    let status = Some(TrackedStatus::Finished);
    let change = TrackedRunChange { name: Some("best".to_owned()), status, end_time };
    let changed = f.store.change_tracked_run(&run.identifier, &change).await.unwrap();
    assert_eq!(f.store.tracked_run(&run.identifier).await.unwrap(), changed);
    assert_eq!((changed.name.as_str(), changed.end_time), ("best", end_time));
    let [_, tags] = texts(&f, &run).await;
    assert_eq!(tags, [pair("mlflow.runName", "best"), pair("note", "first")]);
    assert!(f.store.tracked_run("unknown").await.is_err());
}

pub async fn numbers_and_moments_of_metrics_come_back_bit_by_bit(f: Fixture) {
    let run = created(&f, ExperimentId::DEFAULT).await;
    let extremes = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 5e-324, 0.1 + 0.2];
    for (step, value) in (0..).zip(extremes) {
        let batch = metrics(vec![point("m", step, i64::MAX - step, value)]);
        f.store.log_batch(&run.identifier, &batch).await.unwrap();
    }
    let found = values(&f, &run, "m").await;
    let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&found), bits(&extremes));
    let first = &f.store.tracked_history(run.id, "m", 0, 1).await.unwrap()[0];
    assert_eq!(first.time.milliseconds(), i64::MAX);
    let steps = [i64::MIN, i64::MAX].map(|step| point("far", step, 0, 1.0));
    f.store.log_batch(&run.identifier, &metrics(steps.to_vec())).await.unwrap();
    assert_eq!(latest(&f, &run).await[0].step, i64::MAX);
}

pub async fn a_batch_that_is_sent_again_is_there_once(f: Fixture) {
    let run = created(&f, ExperimentId::DEFAULT).await;
    let many: Vec<_> = (0..2500).map(|step| point("m", step, 7, 0.5)).collect();
    let mut batch = metrics(many);
    batch.metrics.push(point("nan", 1, 7, f64::NAN));
    for _ in 0..2 {
        f.store.log_batch(&run.identifier, &batch).await.unwrap();
    }
    assert_eq!(values(&f, &run, "m").await.len(), 2500);
    assert_eq!(values(&f, &run, "nan").await.len(), 1);
    let page = f.store.tracked_history(run.id, "m", 2400, 1000).await.unwrap();
    assert_eq!((page.len(), page[0].step), (100, 2400));
}

pub async fn the_latest_point_is_that_of_the_highest_step_however_they_come(f: Fixture) {
    let run = created(&f, ExperimentId::DEFAULT).await;
    let log = async |points: Vec<TrackedMetric>| {
        f.store.log_batch(&run.identifier, &metrics(points)).await.unwrap();
        latest(&f, &run)
            .await
            .into_iter()
            .map(|metric| (metric.step, metric.value))
            .collect::<Vec<_>>()
    };
    assert_eq!(log(vec![point("m", 3, 1, 1.0), point("m", 2, 9, 2.0)]).await, [(3, 1.0)]);
    assert_eq!(log(vec![point("m", 1, 10, 3.0)]).await, [(3, 1.0)]);
    assert_eq!(log(vec![point("m", 3, 2, 0.5), point("m", 3, 1, 7.0)]).await, [(3, 0.5)]);
    assert_eq!(log(vec![point("m", 3, 2, 0.75)]).await, [(3, 0.75)]);
}

pub async fn a_param_keeps_its_first_value_and_a_tag_its_last(f: Fixture) {
    let run = created(&f, ExperimentId::DEFAULT).await;
    let log = async |batch: TrackedBatch| f.store.log_batch(&run.identifier, &batch).await;
    log(params(vec![pair("a", "1"), pair("b", "2")])).await.unwrap();
    log(params(vec![pair("a", "1"), pair("c", "3"), pair("c", "3")])).await.unwrap();
    let mut changed = params(vec![pair("d", "4"), pair("b", "9")]);
    changed.metrics.push(point("m", 0, 0, 1.0));
    let error = log(changed).await.unwrap_err();
    let expected = format!(
        "param \"b\" of run {} was logged as \"2\" and cannot be changed to \"9\"",
        run.identifier
    );
    assert_eq!(error.to_string(), expected);
    assert!(log(params(vec![pair("e", "1"), pair("e", "2")])).await.is_err());
    for value in ["first", "last"] {
        let tags = vec![pair("t", value)];
        log(TrackedBatch { tags, ..TrackedBatch::default() }).await.unwrap();
    }
    let [params, tags] = texts(&f, &run).await;
    assert_eq!(params, [pair("a", "1"), pair("b", "2"), pair("c", "3")]);
    assert!(tags.contains(&pair("t", "last")));
    assert!(values(&f, &run, "m").await.is_empty(), "a part of a refused batch was logged");
    f.store.delete_tracked_tag(&run.identifier, "t").await.unwrap();
    assert!(f.store.delete_tracked_tag(&run.identifier, "t").await.is_err());
}

pub async fn a_deleted_run_takes_nothing_until_it_is_restored(f: Fixture) {
    let experiment = f.store.create_experiment("robots", &[]).await.unwrap();
    let run = created(&f, experiment).await;
    f.store.set_tracked_run_deleted(&run.identifier, Some(LONG)).await.unwrap();
    let batch = metrics(vec![point("m", 0, 0, 1.0)]);
    let refused = f.store.log_batch(&run.identifier, &batch).await.unwrap_err();
    assert!(matches!(refused, StoreError::Deleted { what: "run", .. }), "{refused}");
    f.store.set_tracked_run_deleted(&run.identifier, None).await.unwrap();
    f.store.log_batch(&run.identifier, &batch).await.unwrap();
    f.store.set_experiment_deleted(experiment, Some(LONG)).await.unwrap();
    let runs = f.store.tracked_runs(&[experiment]).await.unwrap();
    assert!(runs[0].is_deleted);
    let new = NewTrackedRun {
        experiment,
        name: None,
        user: String::new(),
        start_time: Timestamp::from_milliseconds(0),
        tags: vec![],
    };
    let refused = f.store.create_tracked_run(&new).await.unwrap_err();
    assert!(matches!(refused, StoreError::Deleted { what: "experiment", .. }), "{refused}");
    f.store.set_experiment_deleted(experiment, None).await.unwrap();
    f.store.log_batch(&run.identifier, &batch).await.unwrap();
}

pub async fn a_file_of_a_run_is_replaced_by_the_next_of_its_name(f: Fixture) {
    let run = created(&f, ExperimentId::DEFAULT).await;
    let send = async |name: &str, bytes: &[u8]| {
        let mut writer = f.store.begin_tracked_artifact(&run).await.unwrap();
        writer.write(bytes).await.unwrap();
        writer.finish_as_artifact(&run.identifier, name).await.unwrap();
        f.store.tracked_artifact(&run, name).await.unwrap().object
    };
    let first = send("plots/loss.svg", b"first").await;
    let second = send("plots/loss.svg", b"second").await;
    assert_ne!(first.path, second.path);
    assert_eq!(f.store.read_object(&second).await.unwrap(), b"second".as_slice());
    assert!(f.store.read_object(&first).await.is_err(), "what was replaced is still there");
    send("a.txt", b"").await;
    tokio::time::sleep(Duration::from_millis(5)).await;
    assert_eq!(f.sweep(Duration::ZERO).await, 0, "a file was swept");
    let names = ["plots/loss.svg".to_owned()];
    f.store.delete_tracked_artifacts(&run.identifier, &names).await.unwrap();
    let left = f.store.tracked_artifacts(run.id).await.unwrap();
    assert_eq!(left.into_iter().map(|artifact| artifact.name).collect::<Vec<_>>(), ["a.txt"]);
}
