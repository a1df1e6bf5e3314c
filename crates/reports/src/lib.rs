//! Reports for people: tables and sentences for the terminal, and the report of the paper's study.

mod closed_loop;
mod error_table;
mod outcome;
mod rollout_table;
pub mod study;
mod table;
mod verdict;

pub use closed_loop::closed_loop_text;
use error_table::{by_frequency, by_group};
pub use outcome::ComparisonOutcome;
use rollout_table::by_rollout;
pub use table::{Align, Table};
use verdict::verdicts;

use wire::{PredictorInfo, PredictorKind, Report, Warning};

/// The report of an evaluation as text: tables of the errors, and a sentence about each model.
pub fn text(report: &Report) -> String {
    let (context, horizon) = (report.context, report.horizon);
    let mut text = format!(
        "\nRMSE in degrees over {horizon} samples at {} Hz, given the {context} before: mean \
         [95 % confidence interval]\n\n{}\n",
        report.rate_hz,
        by_group(report)
    );
    let by_frequency = by_frequency(report);
    if !by_frequency.is_empty() {
        text += &format!("{by_frequency}* trained at this frequency\n\n");
    }
    let rollouts = by_rollout(report);
    if !rollouts.is_empty() {
        text += &format!(
            "Error of the first sample, its change from sample to sample, at the seams of patches, and the \
             largest, in degrees;\nshare of predictions that leave the joints' limits, and that get more than \
             180° off\n\n{rollouts}\n"
        );
    }
    text += &warnings(&report.warnings, report.scenarios(), "scenarios");
    for verdict in verdicts(report) {
        text += &format!("{verdict}\n\n");
    }
    text
}

/// One line for each predictor and kind of warning.
fn warnings(warnings: &[Warning], all: u64, each: &str) -> String {
    let sentences = Warning::sentences(warnings, all, each).into_iter();
    let mut text: String = sentences.map(|sentence| format!("warning: {sentence}\n")).collect();
    if !warnings.is_empty() {
        text.push('\n');
    }
    text
}

/// The predictors that are no baselines: checkpoints, and files of predictions.
fn models(report: &Report) -> impl Iterator<Item = &PredictorInfo> {
    report.predictors.iter().filter(|predictor| predictor.kind != PredictorKind::Baseline)
}

/// The name to print. It says if the predictor has seen the future that it predicts.
fn label(predictor: &PredictorInfo) -> String {
    let name = &predictor.name;
    // Checkpoints carry their normalization in their name.
    if predictor.sees_the_future() && !name.contains("paper-leaky") {
        format!("{name} (leak: starts with the truth)")
    } else {
        name.clone()
    }
}

/// An error in hundredths of a degree. Smaller ones have two significant digits, and at most six
/// decimals.
pub fn degrees(x: f64) -> String {
    let decimals = match x.abs() {
        0.0 | 0.1.. => 2,
        0.01.. => 3,
        0.001.. => 4,
        1e-4.. => 5,
        _ => 6,
    };
    format!("{x:.decimals$}")
}

/// A difference with its sign.
fn signed_degrees(x: f64) -> String {
    let sign = if x < 0.0 { "-" } else { "+" };
    format!("{sign}{}", degrees(x.abs()))
}

#[cfg(test)]
fn example() -> Report {
    let interval =
        |mean: f64| serde_json::json!({"mean": mean, "low": mean - 0.5, "high": mean + 0.5});
    let error = |predictor: &str, mean: f64| {
        let mut error = interval(mean);
        error["predictor"] = predictor.into();
        error
    };
    let difference = |group: &str, against: &str, mean: f64| {
        serde_json::json!({"group": group, "predictor": "robomorph", "against": against,
            "difference_deg": interval(mean)})
    };
    let errors =
        [error("hold-last", 8.0), error("damped-integrator", 2.0), error("robomorph", 2.5)];
    let report = serde_json::json!({
        "context": 320, "horizon": 80, "rate_hz": 60.0, "bootstrap": {}, "samples": 1,
        "predictors": [
            {"name": "hold-last", "kind": "baseline"},
            {"name": "damped-integrator", "kind": "baseline"},
            {"name": "robomorph", "kind": "checkpoint", "normalization": "context"},
        ],
        "in_distribution": [{"family": "multisine", "frequency_hz": [0.15, 0.15]}],
        "cells": [
            {"family": "multisine", "frequency_hz": 0.05, "in_distribution": false,
             "scenarios": 100, "rmse_deg": errors},
            {"family": "multisine", "frequency_hz": 0.15, "in_distribution": true,
             "scenarios": 100, "rmse_deg": errors},
        ],
        "groups": [
            {"name": "in distribution", "scenarios": 100, "rmse_deg": errors},
            {"name": "out of distribution", "scenarios": 100, "rmse_deg": errors},
        ],
        "paired": [
            difference("in distribution", "hold-last", -5.5),
            difference("in distribution", "damped-integrator", 0.2),
            difference("out of distribution", "hold-last", -5.5),
            difference("out of distribution", "damped-integrator", 1.2),
        ],
    });
    serde_json::from_value(report).unwrap()
}
