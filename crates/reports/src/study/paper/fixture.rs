//! A study with invented numbers. On every shift the error of a model is its place in the list plus
//! the number of its set. Seeds differ by half a degree, and errors above the band are doubled.

use serde_json::json;
use spec::{Family, StudyEdition, StudyEvaluation, StudyQuestion, StudyScale};
use wire::{Report, Shift};

use super::super::fixture::{interval, record, report, trainings};
use super::super::plan::Plan;
use super::super::results::{Evaluation, File, Study, Training};
use super::errors::IN_DISTRIBUTION;

pub fn study() -> Study {
    let plan = Plan::of(StudyEdition::Paper, StudyScale::Tiny).unwrap();
    let trainings = trainings(&plan);
    let evaluation = |plan: &StudyEvaluation| {
        let report = match plan.question {
            StudyQuestion::WarmStart => warm_start_report(&trainings),
            StudyQuestion::Sweep => sweep(&trainings, plan.set),
            _ => report(&json!({"predictors": [], "groups": [], "paired": []})),
        };
        let figure = File { name: "rmse.svg".to_owned(), bytes: b"<svg/>".to_vec() };
        Evaluation {
            plan: plan.clone(),
            record: record(&plan.job, 900),
            report,
            files: vec![figure],
        }
    };
    Study {
        edition: StudyEdition::Paper,
        scale: StudyScale::Tiny,
        spec: plan.pipeline.clone(),
        pipeline: record("paper-study-tiny", 1),
        evaluations: plan.parts.evaluations.iter().map(evaluation).collect(),
        trainings,
    }
}

/// The trainings of a set with the usual lengths, model by model, after ARX.
fn sweep(trainings: &[Training], set: usize) -> Report {
    let of_set = || {
        trainings
            .iter()
            .filter(|training| training.plan.set == set && training.plan.length.is_none())
    };
    let mut predictors = vec![json!({"name": "arx", "kind": "baseline"})];
    predictors.extend(of_set().map(|training| {
        json!({"name": training.plan.job, "kind": "checkpoint", "digest": training.record.digest})
    }));
    let mut models: Vec<(Vec<String>, f64)> = vec![(vec!["arx".to_owned()], 3.0)];
    let mut names = Vec::new();
    for training in of_set() {
        if !names.contains(&training.plan.model) {
            names.push(training.plan.model.clone());
            models.push((Vec::new(), (names.len() + set) as f64));
        }
        models.last_mut().unwrap().0.push(training.plan.job.clone());
    }
    let summary = |shift: Shift, family: Option<Family>, factor: f64| {
        let scores = models.iter().map(|(predictors, mean)| {
            let count = predictors.len();
            let seeds: Vec<f64> = (0..count).map(|k| factor * mean + 0.5 * k as f64).collect();
            json!({
                "predictors": predictors, "rmse_deg": interval(factor * mean), "seed_rmse_deg": seeds,
                "skill": interval(0.5), "worst_deg": 20.0, "joint_rmse_deg": [1.0, 2.0], "diverged": 0.0,
            })
        });
        let pairs = models
            .iter()
            .enumerate()
            .flat_map(|(k, ours)| models[..k].iter().map(move |theirs| (ours, theirs)));
        let differences = pairs.map(|(ours, theirs)| {
            json!({
                "predictor": ours.0[0], "against": theirs.0[0],
                "difference_deg": interval(factor * (ours.1 - theirs.1)),
            })
        });
        json!({
            "shift": shift, "family": family, "scenarios": 40, "scored": 30,
            "models": scores.collect::<Vec<_>>(), "differences": differences.collect::<Vec<_>>(),
        })
    };
    report(&json!({
        "predictors": predictors,
        "groups": [],
        "paired": [],
        "shifts": [
            summary(Shift::Within, None, 1.0),
            summary(Shift::Above, Some(Family::Chirp), 2.0),
        ],
    }))
}

/// Five warm steps of the CDT: half a degree worse than all hundred, in 30 ms.
fn warm_start_report(trainings: &[Training]) -> Report {
    let cdt = trainings.iter().find(|training| training.plan.job == "d1-cdt-1").unwrap();
    let sampled = |start: &str, steps: u32, p99_ms: f64| {
        json!({
            "name": format!("cdt ddpm {steps} {start}"), "kind": "checkpoint", "digest": cdt.record.digest,
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
