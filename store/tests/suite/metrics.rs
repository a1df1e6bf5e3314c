use store::{Fence, Metric, RunId};

use super::{Fixture, simulate, train};

async fn running(f: &Fixture) -> (Fence, RunId) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    (task.fence, task.run.unwrap())
}

fn loss(step: u64, value: f64) -> Metric {
    Metric { key: "train/loss".into(), step, value }
}

async fn points(f: &Fixture, run: RunId, most: u32) -> Vec<(u64, f64)> {
    let curve = f.store.metric_curve(run, "train/loss", most).await.unwrap();
    curve.points.iter().map(|point| (point.step, point.value)).collect()
}

pub async fn a_step_that_is_taken_again_replaces_its_metrics(f: Fixture) {
    let (fence, run) = running(&f).await;
    f.store.record_metrics(fence, &[loss(1, 5.0), loss(2, 4.0)]).await.unwrap();
    f.store.record_metrics(fence, &[loss(2, 3.0), loss(3, 2.0)]).await.unwrap();
    assert_eq!(points(&f, run, 100).await, [(1, 5.0), (2, 3.0), (3, 2.0)]);
    f.store.record_metrics(fence, &[]).await.unwrap();
}

pub async fn the_latest_value_of_each_key_is_at_hand(f: Fixture) {
    let (fence, run) = running(&f).await;
    let validation = Metric { key: "validation/loss".into(), step: 2, value: 9.0 };
    f.store.record_metrics(fence, &[loss(3, 2.0), loss(1, 5.0), validation]).await.unwrap();
    let latest = || async {
        let latest = f.store.latest_metrics(&[run]).await.unwrap();
        latest.into_iter().map(|(_, key, point)| (key, point.step, point.value)).collect::<Vec<_>>()
    };
    let validation = ("validation/loss".to_owned(), 2, 9.0);
    assert_eq!(latest().await, [("train/loss".to_owned(), 3, 2.0), validation.clone()]);
    let of_key = f.store.latest_values(&[run, RunId(77)], "train/loss").await.unwrap();
    let of_key: Vec<_> =
        of_key.iter().map(|(run, point)| (*run, point.step, point.value)).collect();
    assert_eq!(of_key, [(run, 3, 2.0)]);
    f.store.delete_metrics_after(fence, 2).await.unwrap();
    assert_eq!(latest().await, [("train/loss".to_owned(), 1, 5.0), validation]);
    f.store.delete_metrics_after(fence, 0).await.unwrap();
    assert!(latest().await.is_empty());
    assert!(f.store.latest_metrics(&[]).await.unwrap().is_empty());
}

pub async fn a_long_series_is_thinned_out_without_losing_its_extremes(f: Fixture) {
    let (fence, run) = running(&f).await;
    let mut metrics: Vec<Metric> =
        (0..10_000u32).map(|step| loss(u64::from(step), f64::from(step % 7))).collect();
    metrics[4321].value = 1e6;
    metrics[1234].value = -1e6;
    f.store.record_metrics(fence, &metrics).await.unwrap();
    let curve = f.store.metric_curve(run, "train/loss", 100).await.unwrap();
    assert_eq!(curve.recorded, 10_000);
    assert!(curve.points.len() <= 100 && curve.points.len() > 90, "{}", curve.points.len());
    assert!(curve.points.is_sorted_by_key(|point| point.step));
    let values: Vec<f64> = curve.points.iter().map(|point| point.value).collect();
    assert!(values.contains(&1e6) && values.contains(&-1e6));
    assert_eq!(points(&f, run, 20_000).await.len(), 10_000);
}

pub async fn a_long_series_shows_what_replaced_and_forgotten_points_have_left(f: Fixture) {
    let (fence, run) = running(&f).await;
    let mut metrics: Vec<Metric> =
        (0..10_000u32).map(|step| loss(u64::from(step), f64::from(step % 7))).collect();
    metrics[4321].value = 1e6;
    metrics[7000].value = f64::NAN;
    metrics[9000].value = -1e6;
    // A training records a few points at a time, so that several writes fill a span.
    for part in metrics.chunks(900) {
        f.store.record_metrics(fence, part).await.unwrap();
    }
    let thinned = points(&f, run, 100).await;
    let has =
        |points: &[(u64, f64)], value: f64| points.iter().any(|(_, recorded)| *recorded == value);
    assert!(has(&thinned, 1e6) && has(&thinned, -1e6));
    assert!(thinned.iter().any(|(step, value)| *step == 7000 && value.is_nan()));
    let recorded = |(step, value): &(u64, f64)| {
        usize::try_from(*step).is_ok_and(|step| metrics[step].value.to_bits() == value.to_bits())
    };
    assert!(thinned.iter().filter(|(_, value)| !value.is_nan()).all(recorded));

    f.store.record_metrics(fence, &[loss(4321, 0.0), loss(7000, 0.5)]).await.unwrap();
    f.store.delete_metrics_after(fence, 8500).await.unwrap();
    let thinned = f.store.metric_curve(run, "train/loss", 100).await.unwrap();
    assert_eq!(thinned.recorded, 8501);
    assert!(thinned.points.len() > 90, "{}", thinned.points.len());
    assert!(thinned.points.iter().all(|point| point.step <= 8500));
    assert!(thinned.points.iter().all(|point| (0.0..=6.0).contains(&point.value)));
    f.store.delete_metrics_after(fence, 0).await.unwrap();
    assert_eq!(points(&f, run, 100).await, [(0, 0.0)]);
}

pub async fn a_loss_that_is_not_a_number_is_kept_as_such(f: Fixture) {
    let (fence, run) = running(&f).await;
    f.store.record_metrics(fence, &[loss(1, f64::NAN), loss(2, f64::INFINITY)]).await.unwrap();
    let values = points(&f, run, 10).await;
    assert!(values[0].1.is_nan());
    assert_eq!(values[1], (2, f64::INFINITY));
}

pub async fn an_unknown_key_has_no_points(f: Fixture) {
    let (_, run) = running(&f).await;
    assert!(points(&f, run, 10).await.is_empty());
}
