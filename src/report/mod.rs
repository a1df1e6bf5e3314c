//! An evaluation's report: what it says, as a table and in one sentence.

mod error_table;
mod verdict;

pub use error_table::{by_frequency, by_group};
pub use verdict::verdict;

use serde::Deserialize;

/// The report of an evaluation, as the API returns it. Angles are degrees.
#[derive(Clone, Debug, Deserialize)]
pub struct Report {
    pub context: u32,
    pub horizon: u32,
    pub rate_hz: f64,
    pub predictors: Vec<PredictorInfo>,
    pub cells: Vec<CellErrors>,
    pub groups: Vec<GroupErrors>,
    #[serde(default)]
    pub paired: Vec<PairedDifference>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct PredictorInfo {
    pub name: String,
    pub kind: PredictorKind,
    #[serde(default)]
    pub normalization: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PredictorKind {
    Baseline,
    Checkpoint,
}

/// Errors at one frequency of one excitation family.
#[derive(Clone, Debug, Deserialize)]
pub struct CellErrors {
    pub family: String,
    pub frequency_hz: f64,
    pub in_distribution: bool,
    pub rmse_deg: Vec<PredictorError>,
}

/// Errors over all scenarios of a group of cells.
#[derive(Clone, Debug, Deserialize)]
pub struct GroupErrors {
    pub name: String,
    pub scenarios: u64,
    pub rmse_deg: Vec<PredictorError>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct PredictorError {
    pub predictor: String,
    #[serde(flatten)]
    pub rmse: Interval,
}

/// A mean with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct Interval {
    pub mean: f64,
    pub low: f64,
    pub high: f64,
}

/// How much larger the RMSE of `predictor` is than that of `against`, on the same scenarios.
#[derive(Clone, Debug, Deserialize)]
pub struct PairedDifference {
    pub group: String,
    pub predictor: String,
    pub against: String,
    pub difference_deg: Interval,
}

impl Report {
    /// The first trained predictor.
    fn model(&self) -> Option<&PredictorInfo> {
        self.predictors.iter().find(|predictor| predictor.kind == PredictorKind::Checkpoint)
    }
}

impl PredictorInfo {
    /// The name to print; says so when the predictor has seen the future it predicts.
    fn label(&self) -> String {
        match self.normalization.as_deref() {
            Some("paper-leaky") => format!("{} (paper-leaky)", self.name),
            _ => self.name.clone(),
        }
    }
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
        "context": 320, "horizon": 80, "rate_hz": 60.0,
        "predictors": [
            {"name": "hold-last", "kind": "baseline"},
            {"name": "damped-integrator", "kind": "baseline"},
            {"name": "robomorph", "kind": "checkpoint", "digest": "ab", "normalization": "context"},
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
