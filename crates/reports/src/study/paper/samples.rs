//! Scores of models with several predictions per scenario, as distributions.

use spec::StudyQuestion;
use wire::{GroupSummary, IntervalSummary, PredictorScores};

use crate::TableOf;
use crate::numbers::degrees;

use super::super::results::{Evaluation, Study};

/// A model in a group of cells, with the scores of its trainings.
struct Row<'a> {
    evaluation: &'a Evaluation,
    group: &'a GroupSummary,
    name: &'a str,
    scores: Vec<&'a PredictorScores>,
}

/// A table with one row for each training set, group of cells and model with samples.
pub fn table(study: &Study) -> String {
    let mut rows = Vec::new();
    for evaluation in &study.evaluations {
        if evaluation.plan.question != StudyQuestion::Samples {
            continue;
        }
        for group in &evaluation.report.groups {
            for name in study.names(evaluation) {
                let is_here = |scores: &&PredictorScores| {
                    scores.crps_deg.is_some() && study.called(evaluation, &scores.predictor) == name
                };
                let scores: Vec<_> = group.scores.iter().filter(is_here).collect();
                if !scores.is_empty() {
                    rows.push(Row { evaluation, group, name, scores });
                }
            }
        }
    }
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    TableOf::new(rows)
        .text("trained on", |row| format!("D{}", row.evaluation.plan.set))
        .text("cells", |row| row.group.name.as_str())
        .text("", |row| row.name)
        .text("RMSE", |row| row.spread(degrees, |scores| row.rmse(scores)))
        .text("RMSE of the mean", |row| {
            row.spread(degrees, |scores| Some(scores.mean_rmse_deg?.mean))
        })
        .text("CRPS", |row| row.spread(degrees, |scores| Some(scores.crps_deg?.mean)))
        .text("in 50 %", |row| {
            row.spread(percent, |scores| Some(interval(scores, 0.5)?.coverage.mean))
        })
        .text("in 90 %", |row| {
            row.spread(percent, |scores| Some(interval(scores, 0.9)?.coverage.mean))
        })
        .text("width of 90 %", |row| {
            row.spread(degrees, |scores| Some(interval(scores, 0.9)?.width_deg.mean))
        })
        .to_markdown()
}

fn interval(scores: &PredictorScores, nominal: f64) -> Option<&IntervalSummary> {
    scores.intervals.iter().find(|interval| (interval.nominal - nominal).abs() < 1e-9)
}

impl Row<'_> {
    fn rmse(&self, scores: &PredictorScores) -> Option<f64> {
        let error = self.group.rmse_deg.iter().find(|rmse| rmse.predictor == scores.predictor)?;
        Some(error.interval.mean)
    }

    /// The mean over trainings, with the smallest and the largest value. `None` unless all trainings
    /// have one.
    fn spread(
        &self,
        show: impl Fn(f64) -> String,
        of: impl Fn(&PredictorScores) -> Option<f64>,
    ) -> Option<String> {
        let values: Vec<f64> =
            self.scores.iter().map(|scores| of(scores)).collect::<Option<_>>()?;
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if values.len() == 1 {
            return Some(show(mean));
        }
        Some(format!("{} ({} to {})", show(mean), show(least), show(most)))
    }
}
