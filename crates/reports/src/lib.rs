//! The results of jobs for people to read.
//!
//! A result is a [`Table`]: columns, and rows of [`Cell`]s that know their unit. The terminal, the
//! page, CSV and Markdown each show any table. Sentences say what a table cannot: the setting, the
//! failures, the warnings, and a verdict on each model. [`study`] writes the folder with the report
//! of a study.

#![warn(missing_docs)]

mod cell;
pub mod channels;
pub mod closed_loop;
pub mod comparison;
pub mod evaluation;
pub mod identification;
pub mod json;
pub mod lists;
pub mod log_check;
pub mod numbers;
mod outcome;
pub mod robot;
pub mod study;
mod table;
pub mod trajectory_predictions;
mod verdict;

pub use cell::Cell;
pub use table::{Align, Column, Table, TableOf};

use numbers::{degrees, signed_degrees};
use outcome::ComparisonOutcome;
use verdict::verdicts;
use wire::{Headline, MeanError, PredictorInfo, PredictorKind, Report, Warning};

/// The report of an evaluation as text: the answer, tables of the errors, and a sentence about each
/// model.
pub fn text(report: &Report) -> String {
    let report = &evaluation::ranked(report);
    let sentences = [evaluation::answer(report), evaluation::setting(report)];
    let sentences = sentences.iter().filter(|sentence| !sentence.is_empty());
    let mut text = "\n".to_owned();
    text.extend(sentences.map(|sentence| format!("{sentence}\n\n")));
    for failure in evaluation::failures(report) {
        text += &format!("failed: {failure}\n\n");
    }
    let by_frequency = evaluation::by_frequency(report).into_iter().map(Table::means);
    let first = [
        evaluation::errors(report),
        evaluation::over_horizons(report).means(),
        evaluation::over_seeds(report),
        evaluation::skill(report),
    ];
    let last = [evaluation::continuity(report), evaluation::samples(report)];
    let tables = first.into_iter().chain(by_frequency).chain(last);
    text.extend(tables.map(|table| table.with_title()));
    text += &warnings(&report.warnings, report.scenarios(), "scenarios");
    for verdict in verdicts(report) {
        text += &format!("{verdict}\n\n");
    }
    text
}

/// The key result of an evaluation in a line.
pub fn headline(headline: &Headline) -> String {
    let doubt = |error: &MeanError| {
        ComparisonOutcome::on(headline.scenarios?, error.difference_deg?).doubt()
    };
    let error = |error: &MeanError| {
        let doubt = doubt(error).map_or(String::new(), |doubt| format!(" ({doubt})"));
        format!("{} {}°{doubt}", error.predictor, degrees(error.rmse_deg))
    };
    let best: Vec<String> = headline.best.iter().map(error).collect();
    match best.as_slice() {
        [] => String::new(),
        best => format!("{}: {}", headline.group, best.join(" · ")),
    }
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
