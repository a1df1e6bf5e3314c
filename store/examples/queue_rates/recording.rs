//! Measures how fast the database records the metrics of trainings.

use std::time::{Duration, Instant};

use serde_json::json;
use spec::{Digest, Resources};
use store::{Access, Fence, Location, Metric, Output, Store};

use crate::Outcome;
use crate::submitting::{nothing, submit};

const LASTS: Duration = Duration::from_secs(3);
const LEASE: Duration = Duration::from_secs(60);

/// Values per write: one for each of this many steps of a training.
const BATCH: u64 = 100;

/// A training whose spec has the fields that lists show.
const TRAINING: &[u8] =
    br#"{"kind": "train", "steps": 10000, "model": {"preset": "robomorph-small"},
    "data": {"stream": {"preset": "D2-mixed"}}}"#;

/// The metrics that a training records.
const KEYS: [&str; 5] = [
    "train/gradient_norm",
    "train/learning_rate",
    "train/seconds",
    "validation/loss",
    "validation/rmse_deg",
];

/// Points per write.
const PART: usize = 4000;

/// Prints how many values `trainings` trainings record per second, each with its own connections.
pub async fn run(place: &Location, trainings: u32) -> Outcome<()> {
    let server = Store::open_at(place, Access::Server).await?;
    for number in 0..trainings {
        let digest = Digest::of_json(&json!({"training": number}));
        submit(&server, store::NewJob { digest, output: Output::Run, ..nothing(1) }).await?;
    }
    let mut recording = Vec::new();
    for number in 0..trainings {
        let store = Store::open_at(place, Access::Worker).await?;
        let claimed = store.claim(&format!("w{number}"), &Resources::default(), LEASE).await?;
        let fence = claimed.ok_or("nothing to claim")?.fence;
        recording.push((store, fence));
    }
    let began = Instant::now();
    let recording: Vec<_> =
        recording.into_iter().map(|(store, fence)| tokio::spawn(record(store, fence))).collect();
    let mut values = 0;
    for training in recording {
        values += training.await??;
    }
    println!("{}", per_second(values, began.elapsed()));
    Ok(())
}

/// Makes `count` runs that have ended, each with the metrics of a step. The last one also has
/// `points` losses. Prints the last one's id.
pub async fn runs(place: &Location, count: u32, points: u64) -> Outcome<()> {
    let store = Store::open_at(place, Access::Server).await?;
    let spec = spec::parse(TRAINING)?.to_json();
    let mut last = None;
    for number in 0..count {
        let job = store::NewJob {
            name: format!("training {number}"),
            kind: "train".to_owned(),
            digest: Digest::of_json(&json!({"training": number})),
            spec: spec.clone(),
            output: Output::Run,
            ..nothing(1)
        };
        submit(&store, job).await?;
        let claimed = store.claim("w", &Resources::default(), LEASE).await?;
        let claimed = claimed.ok_or("nothing to claim")?;
        let value = f64::from(number);
        let metric = |key: &&str| Metric { key: (*key).to_owned(), step: 1, value };
        let mut metrics: Vec<Metric> = KEYS.iter().map(metric).collect();
        store.record_metrics(claimed.fence, &metrics).await?;
        if number + 1 == count {
            for first in (0..points).step_by(PART) {
                metrics.clear();
                metrics.extend((first..points).take(PART).map(loss));
                store.record_metrics(claimed.fence, &metrics).await?;
            }
        }
        store.complete(claimed.fence, None).await?;
        last = claimed.run;
    }
    store.close().await;
    println!("{}", last.ok_or("no runs")?);
    Ok(())
}

#[expect(clippy::cast_precision_loss, reason = "far fewer steps than 2^52")]
fn loss(step: u64) -> Metric {
    Metric { key: "train/loss".to_owned(), step, value: (step as f64 / 1000.0).sin() }
}

async fn record(store: Store, fence: Fence) -> Outcome<u64> {
    let began = Instant::now();
    let mut step = 0;
    while began.elapsed() < LASTS {
        let metric = |step| Metric { key: "train/loss".to_owned(), step, value: 0.5 };
        let metrics: Vec<Metric> = (step..step + BATCH).map(metric).collect();
        store.record_metrics(fence, &metrics).await?;
        step += BATCH;
    }
    Ok(step)
}

#[expect(clippy::cast_precision_loss, reason = "far fewer values than 2^52")]
fn per_second(values: u64, elapsed: Duration) -> f64 {
    values as f64 / elapsed.as_secs_f64()
}
