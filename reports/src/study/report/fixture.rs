//! A study of made-up numbers: model k of training set s errs by k + s degrees in distribution and
//! twice as much out of it.

use serde_json::{Value, json};
use spec::Digest;
use wire::Report;

use super::super::plan::{Plan, Scale};
use super::super::results::{Evaluation, File, JobRecord, MODELS, Set, Study, Training};
use super::errors::{IN_DISTRIBUTION, OUT_OF_DISTRIBUTION};

pub fn study() -> Study {
    Study {
        scale: Scale::Tiny,
        spec: Plan::of(Scale::Tiny).unwrap().pipeline,
        pipeline: record("paper-study-tiny", 1),
        sets: vec![set(1), set(2)],
        warm_start: evaluation("warm-start", 90, warm_start_report(2)),
    }
}

fn set(number: usize) -> Set {
    let training = |(k, model): (usize, &str)| Training {
        model: model.to_owned(),
        record: JobRecord {
            digest: digest(number, k),
            ..record(&format!("d{number}-{model}"), 10)
        },
        checkpoint: 5,
        sha256: "ab".repeat(32),
        steps: 200,
        validation_rmse_deg: Some(1.5),
    };
    let of_set = |name: &str, job| evaluation(&format!("d{number}-{name}"), job, sweep(number));
    Set {
        name: format!("D{number}"),
        data: record(&format!("d{number}-data"), 2),
        trajectories: 8192,
        trainings: MODELS.into_iter().enumerate().map(training).collect(),
        sweep: of_set("sweep", 20),
        samples: of_set("samples", 30),
    }
}

fn record(name: &str, job: i64) -> JobRecord {
    JobRecord {
        name: name.to_owned(),
        job,
        digest: format!("{job:064x}").parse().unwrap(),
        seconds: Some(60.0),
        reused: false,
    }
}

fn digest(set: usize, model: usize) -> Digest {
    format!("{:064x}", 100 * set + model).parse().unwrap()
}

fn evaluation(name: &str, job: i64, report: Report) -> Evaluation {
    let figure = File { name: "rmse.svg".to_owned(), bytes: b"<svg/>".to_vec() };
    Evaluation { record: record(name, job), report, files: vec![figure] }
}

fn interval(mean: f64) -> Value {
    json!({"mean": mean, "low": mean - 0.1, "high": mean + 0.1})
}

/// Names are those of the report, not of the study.
fn sweep(set: usize) -> Report {
    let predictor = |k: usize| format!("checkpoint {k}");
    let mut predictors = vec![json!({"name": "arx", "kind": "baseline"})];
    let of_models = MODELS.iter().enumerate().map(
        |(k, _)| json!({"name": predictor(k), "kind": "checkpoint", "digest": digest(set, k)}),
    );
    predictors.extend(of_models);
    let error = |k: usize, factor: f64| factor * (1 + k + set) as f64;
    let group = |name: &str, factor: f64| {
        let errors = (0..MODELS.len()).map(|k| {
            let mut interval = interval(error(k, factor));
            interval["predictor"] = predictor(k).into();
            interval
        });
        json!({"name": name, "scenarios": 40, "rmse_deg": errors.collect::<Vec<_>>()})
    };
    let mut paired = Vec::new();
    for (name, factor) in [(IN_DISTRIBUTION, 1.0), (OUT_OF_DISTRIBUTION, 2.0)] {
        for k in 0..MODELS.len() {
            paired.push(json!({
                "group": name, "predictor": predictor(k), "against": "arx",
                "difference_deg": interval(error(k, factor)),
            }));
            for before in 0..k {
                let difference = error(k, factor) - error(before, factor);
                paired.push(json!({
                    "group": name, "predictor": predictor(k), "against": predictor(before),
                    "difference_deg": interval(difference),
                }));
            }
        }
    }
    report(&json!({
        "predictors": predictors,
        "groups": [group(IN_DISTRIBUTION, 1.0), group(OUT_OF_DISTRIBUTION, 2.0)],
        "paired": paired,
    }))
}

/// Five warm steps of the CDT: half a degree worse than all hundred, in 30 ms.
fn warm_start_report(set: usize) -> Report {
    let sampled = |start: &str, steps: u32, p99_ms: f64| {
        json!({
            "name": format!("cdt ddpm {steps} {start}"), "kind": "checkpoint", "digest": digest(set, 4),
            "sampling": {"curve": format!("cdt ddpm {start}"), "kind": "ddpm", "steps": steps,
                "start": start},
            "latency": {"median_ms": p99_ms / 2.0, "p99_ms": p99_ms, "threads": 2,
                "repeats": 100, "device": "cpu"},
        })
    };
    let error = |predictor: &str, mean: f64| {
        let mut interval = interval(mean);
        interval["predictor"] = predictor.into();
        interval
    };
    let errors = [error("cdt ddpm 100 cold", 2.0), error("cdt ddpm 5 shifted", 2.5)];
    report(&json!({
        "predictors": [sampled("cold", 100, 600.0), sampled("shifted", 5, 30.0)],
        "groups": [{"name": IN_DISTRIBUTION, "scenarios": 8, "rmse_deg": errors}],
        "paired": [{
            "group": IN_DISTRIBUTION, "predictor": "cdt ddpm 5 shifted",
            "against": "cdt ddpm 100 cold", "difference_deg": interval(0.5),
        }],
    }))
}

fn report(parts: &Value) -> Report {
    let mut whole = json!({
        "context": 320, "horizon": 80, "rate_hz": 60.0, "bootstrap": {}, "samples": 1, "in_distribution": [],
        "cells": [],
    });
    let (whole_fields, parts) = (whole.as_object_mut().unwrap(), parts.as_object().unwrap());
    whole_fields.extend(parts.clone());
    serde_json::from_value(whole).unwrap()
}
