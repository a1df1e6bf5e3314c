//! Scores of models with several predictions per scenario, as distributions.

use spec::StudyQuestion;
use wire::{GroupSummary, PredictorScores};

use crate::numbers::degrees;

use super::super::results::{Evaluation, Study};
use super::text::{markdown, none};

/// A table with one row for each training set, group of cells and model.
pub fn table(study: &Study) -> String {
    let mut rows = Vec::new();
    for evaluation in study
        .evaluations
        .iter()
        .filter(|evaluation| evaluation.plan.question == StudyQuestion::Samples)
    {
        for group in &evaluation.report.groups {
            for name in study.names(evaluation) {
                rows.extend(row(study, evaluation, group, name));
            }
        }
    }
    let columns = [
        "trained on",
        "cells",
        "",
        "RMSE",
        "RMSE of the mean",
        "CRPS",
        "in 50 %",
        "in 90 %",
        "width of 90 %",
    ];
    markdown(&columns, &rows)
}

/// A row of the table; `None` for a predictor without samples.
fn row(
    study: &Study,
    evaluation: &Evaluation,
    group: &GroupSummary,
    name: &str,
) -> Option<Vec<String>> {
    let of_model: Vec<&PredictorScores> = group
        .scores
        .iter()
        .filter(|scores| scores.crps_deg.is_some())
        .filter(|scores| study.called(evaluation, &scores.predictor) == name)
        .collect();
    if of_model.is_empty() {
        return None;
    }
    let each = |of: &dyn Fn(&PredictorScores) -> Option<f64>| {
        of_model.iter().map(|scores| of(scores)).collect::<Option<Vec<f64>>>()
    };
    let rmse = |scores: &PredictorScores| {
        let error = group.rmse_deg.iter().find(|rmse| rmse.predictor == scores.predictor)?;
        Some(error.interval.mean)
    };
    let interval = |scores: &PredictorScores, nominal: f64| {
        let found =
            scores.intervals.iter().find(|interval| (interval.nominal - nominal).abs() < 1e-9)?;
        Some((found.coverage.mean, found.width_deg.mean))
    };
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    Some(vec![
        format!("D{}", evaluation.plan.set),
        group.name.clone(),
        name.to_owned(),
        spread(each(&rmse), degrees),
        spread(each(&|scores| Some(scores.mean_rmse_deg?.mean)), degrees),
        spread(each(&|scores| Some(scores.crps_deg?.mean)), degrees),
        spread(each(&|scores| Some(interval(scores, 0.5)?.0)), percent),
        spread(each(&|scores| Some(interval(scores, 0.9)?.0)), percent),
        spread(each(&|scores| Some(interval(scores, 0.9)?.1)), degrees),
    ])
}

/// The mean over trainings, with the smallest and the largest value.
fn spread(values: Option<Vec<f64>>, show: impl Fn(f64) -> String) -> String {
    let Some(values) = values.filter(|values| !values.is_empty()) else { return none() };
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if values.len() == 1 {
        return show(mean);
    }
    format!("{} ({} to {})", show(mean), show(least), show(most))
}
