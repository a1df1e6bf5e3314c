//! The report of an evaluation as tables.

use spec::Normalization;

use crate::app::{Interval, PairedDifference, PredictorKind, Report, ReportedPredictor, Rmse};
use crate::page::text;

pub struct ReportView {
    pub setting: String,
    pub predictors: Vec<String>,
    /// Column headings of the summary: each group with its number of scenarios.
    pub groups: Vec<String>,
    pub summary: Vec<SummaryRow>,
    pub paired: Vec<PairedRow>,
    pub cells: Vec<CellRow>,
}

pub struct SummaryRow {
    pub predictor: String,
    pub remark: String,
    pub values: Vec<Cell>,
}

pub struct CellRow {
    pub family: String,
    pub frequency_hz: String,
    pub in_distribution: bool,
    pub scenarios: u64,
    pub values: Vec<Cell>,
}

pub struct PairedRow {
    pub predictor: String,
    pub against: String,
    pub group: String,
    pub mean: String,
    pub interval: String,
    pub verdict: &'static str,
}

/// A mean with its interval.
pub struct Cell {
    pub mean: String,
    pub interval: String,
    /// The lowest mean among the predictors of the same scenarios.
    pub best: bool,
}

impl ReportView {
    pub fn new(report: &Report) -> Self {
        let names: Vec<&str> = report.predictors.iter().map(|it| it.name.as_str()).collect();
        let by_group: Vec<Vec<Cell>> =
            report.groups.iter().map(|group| row(&names, &group.rmse_deg)).collect();
        Self {
            setting: setting(report),
            predictors: report.predictors.iter().map(|it| it.name.clone()).collect(),
            groups: report
                .groups
                .iter()
                .map(|group| format!("{} ({} scenarios)", group.name, text::count(group.scenarios)))
                .collect(),
            summary: transpose(&report.predictors, by_group),
            paired: report.paired.iter().map(PairedRow::new).collect(),
            cells: report
                .cells
                .iter()
                .map(|cell| CellRow {
                    family: cell.family.to_string(),
                    frequency_hz: cell.frequency_hz.to_string(),
                    in_distribution: cell.in_distribution,
                    scenarios: cell.scenarios,
                    values: row(&names, &cell.rmse_deg),
                })
                .collect(),
        }
    }
}

fn setting(report: &Report) -> String {
    let seconds = |samples: u32| text::value(f64::from(samples) / report.rate_hz);
    let trained: Vec<String> = report
        .in_distribution
        .iter()
        .map(|band| match band.frequency_hz {
            range if range.min < range.max => {
                format!("{} {} to {} Hz", band.family, range.min, range.max)
            }
            range => format!("{} {} Hz", band.family, range.min),
        })
        .collect();
    let trained = match trained.as_slice() {
        [] => "no checkpoint, so nothing is in distribution".to_owned(),
        bands => format!("in distribution: {}", bands.join(", ")),
    };
    format!(
        "Every predictor is given {} samples ({} s) and predicts the next {} ({} s) at {} Hz; {trained}.",
        report.context,
        seconds(report.context),
        report.horizon,
        seconds(report.horizon),
        report.rate_hz,
    )
}

/// The values of `found` in the order of `predictors`, the best of them marked.
fn row(predictors: &[&str], found: &[Rmse]) -> Vec<Cell> {
    let lowest = found.iter().map(|rmse| rmse.mean).fold(f64::INFINITY, f64::min);
    predictors
        .iter()
        .map(|name| match found.iter().find(|rmse| rmse.predictor == *name) {
            Some(rmse) => Cell {
                mean: text::degrees(rmse.mean),
                interval: interval(rmse.low, rmse.high),
                best: rmse.mean <= lowest,
            },
            None => Cell { mean: "–".to_owned(), interval: String::new(), best: false },
        })
        .collect()
}

fn interval(low: f64, high: f64) -> String {
    format!("[{}, {}]", text::degrees(low), text::degrees(high))
}

fn transpose(predictors: &[ReportedPredictor], by_group: Vec<Vec<Cell>>) -> Vec<SummaryRow> {
    let mut rows: Vec<SummaryRow> = predictors
        .iter()
        .map(|it| SummaryRow {
            predictor: it.name.clone(),
            remark: remark(it).to_owned(),
            values: Vec::with_capacity(by_group.len()),
        })
        .collect();
    for column in by_group {
        for (row, cell) in rows.iter_mut().zip(column) {
            row.values.push(cell);
        }
    }
    rows
}

fn remark(predictor: &ReportedPredictor) -> &'static str {
    match (predictor.kind, predictor.normalization) {
        (PredictorKind::Baseline, _) => "baseline",
        (PredictorKind::Checkpoint, Some(Normalization::PaperLeaky)) => {
            "sees the future: paper-leaky normalization"
        }
        (PredictorKind::Checkpoint, _) => "",
    }
}

impl PairedRow {
    fn new(paired: &PairedDifference) -> Self {
        let Interval { mean, low, high } = paired.difference_deg;
        let verdict = if high < 0.0 {
            "better"
        } else if low > 0.0 {
            "worse"
        } else {
            "not told apart"
        };
        Self {
            predictor: paired.predictor.clone(),
            against: paired.against.clone(),
            group: paired.group.clone(),
            mean: text::signed_degrees(mean),
            interval: format!("[{}, {}]", text::signed_degrees(low), text::signed_degrees(high)),
            verdict,
        }
    }
}

/// The key result of an evaluation in a line: the best checkpoint beside the best baseline, on
/// what was seen in training.
pub fn headline(report: &Report) -> String {
    let Some(group) = report.groups.first() else { return String::new() };
    let best = |kind: PredictorKind| {
        let of_kind = |rmse: &&Rmse| {
            report.predictors.iter().any(|it| it.kind == kind && it.name == rmse.predictor)
        };
        group.rmse_deg.iter().filter(of_kind).min_by(|a, b| a.mean.total_cmp(&b.mean))
    };
    let parts: Vec<String> = [best(PredictorKind::Checkpoint), best(PredictorKind::Baseline)]
        .into_iter()
        .flatten()
        .map(|rmse| format!("{} {}°", rmse.predictor, text::degrees(rmse.mean)))
        .collect();
    match parts.as_slice() {
        [] => String::new(),
        parts => format!("{}: {}", group.name, parts.join(" · ")),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn report() -> Report {
        let rmse = |model: f64| {
            json!([
                {"predictor": "hold-last", "mean": 3.0, "low": 2.8, "high": 3.2},
                {"predictor": "robomorph", "mean": model, "low": model - 0.1, "high": model + 0.1},
            ])
        };
        let paired = |low: f64, high: f64| {
            json!({"group": "in distribution", "predictor": "robomorph", "against": "hold-last",
                   "difference_deg": {"mean": (low + high) / 2.0, "low": low, "high": high}})
        };
        serde_json::from_value(json!({
            "context": 320, "horizon": 80, "rate_hz": 60.0,
            "predictors": [
                {"name": "hold-last", "kind": "baseline"},
                {"name": "robomorph", "kind": "checkpoint", "normalization": "context"},
            ],
            "in_distribution": [{"family": "multisine", "frequency_hz": [0.15, 0.15]}],
            "cells": [{"family": "multisine", "frequency_hz": 0.15, "in_distribution": true,
                       "scenarios": 100, "rmse_deg": rmse(1.25)}],
            "groups": [
                {"name": "in distribution", "scenarios": 100, "rmse_deg": rmse(1.25)},
                {"name": "out of distribution", "scenarios": 600, "rmse_deg": rmse(4.0)},
            ],
            "paired": [paired(-2.0, -1.5), paired(-0.1, 0.1), paired(0.5, 1.0)],
        }))
        .unwrap()
    }

    #[test]
    fn the_headline_puts_the_best_checkpoint_beside_the_best_baseline() {
        assert_eq!(headline(&report()), "in distribution: robomorph 1.25° · hold-last 3.00°");
    }

    #[test]
    fn the_best_of_each_group_is_marked() {
        let view = ReportView::new(&report());
        let best: Vec<Vec<bool>> = view
            .summary
            .iter()
            .map(|row| row.values.iter().map(|cell| cell.best).collect())
            .collect();
        assert_eq!(best, [[false, true], [true, false]]);
    }

    #[test]
    fn a_difference_is_only_called_one_when_its_interval_excludes_zero() {
        let verdicts: Vec<&str> =
            ReportView::new(&report()).paired.iter().map(|row| row.verdict).collect();
        assert_eq!(verdicts, ["better", "not told apart", "worse"]);
    }
}
