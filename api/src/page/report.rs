//! The report of an evaluation as tables.

use spec::{Family, Normalization};
use wire::{
    DataNoise, FailureSummary, GroupSummary, Headline, Interval, MeanError, PairedDifference,
    PredictorInfo, PredictorKind, PredictorSummary, Report, Warning, at_noise,
};

use crate::page::text;

pub struct ReportView {
    pub setting: String,
    /// A note about latencies and what they depend on. Empty without latencies.
    pub latency_note: String,
    pub failures: Vec<FailureRow>,
    /// Sentences about data outside the checkpoints' training data.
    pub warnings: Vec<String>,
    /// Rows of scores for predictions with several samples, by group.
    pub distributions: Vec<DistributionRow>,
    /// Rows of how predictions begin, how they jump and how far they go, by group.
    pub rollouts: Vec<RolloutRow>,
    pub latencies: Vec<LatencyRow>,
    pub worst: Vec<WorstRow>,
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
    pub values: Vec<MeanWithInterval>,
}

pub struct FailureRow {
    pub predictor: String,
    pub cell: String,
    pub text: String,
}

pub struct DistributionRow {
    pub predictor: String,
    pub group: String,
    pub crps: String,
    pub energy_score: String,
    pub mean_rmse: String,
    /// Coverage and width of each interval.
    pub intervals: Vec<String>,
}

pub struct RolloutRow {
    pub predictor: String,
    pub group: String,
    pub first_sample: String,
    pub jump: String,
    pub seam_jump: String,
    pub largest_jump: String,
    pub left_limits: String,
    pub diverged: String,
}

pub struct LatencyRow {
    pub predictor: String,
    pub median_ms: String,
    pub p99_ms: String,
}

/// The worst scenario of a predictor.
pub struct WorstRow {
    pub predictor: String,
    pub cell: String,
    pub trajectory: u64,
    pub seed: String,
    pub rmse: String,
}

pub struct CellRow {
    pub family: String,
    pub frequency_hz: String,
    pub in_distribution: bool,
    pub scenarios: u64,
    pub values: Vec<MeanWithInterval>,
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
pub struct MeanWithInterval {
    pub mean: String,
    pub interval: String,
    /// Whether it is the lowest mean among the predictors of the same scenarios.
    pub best: bool,
}

impl ReportView {
    pub fn new(report: &Report) -> Self {
        let predictors = &report.predictors;
        let by_group: Vec<Vec<MeanWithInterval>> =
            report.groups.iter().map(|group| row(predictors, &group.rmse_deg)).collect();
        Self {
            setting: setting(report),
            latency_note: latency_note(report),
            failures: report.failures.iter().map(FailureRow::new).collect(),
            warnings: Warning::sentences(&report.warnings, report.scenarios(), "scenarios"),
            distributions: distributions(report),
            rollouts: rollouts(report),
            latencies: report.predictors.iter().filter_map(LatencyRow::of).collect(),
            worst: worst(report),
            predictors: report.predictors.iter().map(|info| info.name.clone()).collect(),
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
                    family: cell.family.map_or("all".to_owned(), |family| family.to_string())
                        + &at_noise(cell.position_noise_rad),
                    frequency_hz: cell.frequency_hz.map_or("–".to_owned(), |hz| hz.to_string()),
                    in_distribution: cell.in_distribution,
                    scenarios: cell.scenarios,
                    values: row(predictors, &cell.rmse_deg),
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
    let noise = report.data_noise.map_or(String::new(), |noise| {
        let DataNoise { position_rad, torque_nm } = noise;
        format!(
            " The data's own noise has standard deviations of {position_rad} rad and {torque_nm} N·m."
        )
    });
    format!(
        "Every predictor is given {} samples ({} s) and predicts the next {} ({} s) at {} Hz; {trained}.{noise}",
        report.context,
        seconds(report.context),
        report.horizon,
        seconds(report.horizon),
        report.rate_hz,
    )
}

fn cell_name(family: Option<Family>, frequency_hz: Option<f64>) -> String {
    match (family, frequency_hz) {
        (Some(family), Some(frequency_hz)) => format!("{family} {frequency_hz} Hz"),
        _ => "all scenarios".to_owned(),
    }
}

fn latency_note(report: &Report) -> String {
    let Some(latency) = report.predictors.iter().find_map(|info| info.latency.as_ref()) else {
        return String::new();
    };
    let load = latency.load.map_or(String::new(), |load| format!(", load {load} before"));
    format!(
        "One prediction of one robot, {} times each, on {} with {} threads{load}. These numbers are the \
         machine's as much as the predictors': they differ whenever they are measured.",
        latency.repeats, latency.device, latency.threads,
    )
}

fn distributions(report: &Report) -> Vec<DistributionRow> {
    let rows = report.groups.iter().flat_map(|group| {
        group.scores.iter().filter_map(|scores| {
            let shown = |interval: &Option<Interval>| {
                interval.map_or("–".to_owned(), |Interval { mean, .. }| text::degrees(mean))
            };
            scores.crps_deg?;
            let intervals = scores.intervals.iter().map(|interval| {
                let (nominal, coverage) =
                    (100.0 * interval.nominal, 100.0 * interval.coverage.mean);
                let width = text::degrees(interval.width_deg.mean);
                format!("{nominal:.0} %: {coverage:.0} % inside, {width}° wide")
            });
            Some(DistributionRow {
                predictor: scores.predictor.clone(),
                group: group.name.clone(),
                crps: shown(&scores.crps_deg),
                energy_score: shown(&scores.energy_score_deg),
                mean_rmse: shown(&scores.mean_rmse_deg),
                intervals: intervals.collect(),
            })
        })
    });
    rows.collect()
}

/// Empty for a report from before this was measured.
fn rollouts(report: &Report) -> Vec<RolloutRow> {
    let row = |group: &GroupSummary, info: &PredictorInfo| {
        let scores = group.scores.iter().find(|scores| scores.predictor == info.name);
        let scores = scores.filter(|scores| scores.first_sample_deg.is_some());
        let rollouts = group.rollouts.iter().find(|rollouts| rollouts.predictor == info.name);
        if scores.is_none() && rollouts.is_none() {
            return None;
        }
        let degrees = |interval: Option<Interval>| {
            interval.map_or("–".to_owned(), |Interval { mean, .. }| text::degrees(mean))
        };
        let share = |fraction: Option<f64>| {
            fraction.map_or("–".to_owned(), |share| format!("{:.1} %", 100.0 * share))
        };
        Some(RolloutRow {
            predictor: info.name.clone(),
            group: group.name.clone(),
            first_sample: degrees(scores.and_then(|scores| scores.first_sample_deg)),
            jump: degrees(scores.and_then(|scores| scores.jump_deg)),
            seam_jump: degrees(scores.and_then(|scores| scores.seam_jump_deg)),
            largest_jump: degrees(scores.and_then(|scores| scores.largest_jump_deg)),
            left_limits: share(rollouts.and_then(|rollouts| rollouts.left_limits)),
            diverged: share(rollouts.map(|rollouts| rollouts.diverged)),
        })
    };
    let of_group =
        |group| report.predictors.iter().filter_map(move |predictor| row(group, predictor));
    report.groups.iter().flat_map(of_group).collect()
}

/// The worst scenario of each predictor, which comes first in the report.
fn worst(report: &Report) -> Vec<WorstRow> {
    let of = |info: &PredictorInfo| {
        let case = report.worst.iter().find(|case| case.predictor == info.name)?;
        Some(WorstRow {
            predictor: case.predictor.clone(),
            cell: cell_name(case.family, case.frequency_hz) + &at_noise(case.position_noise_rad),
            trajectory: case.trajectory,
            seed: case.seed.map_or("recorded".to_owned(), |seed| seed.to_string()),
            rmse: text::degrees(case.rmse_deg),
        })
    };
    report.predictors.iter().filter_map(of).collect()
}

impl FailureRow {
    fn new(failure: &FailureSummary) -> Self {
        let FailureSummary { scenarios, first, reason, .. } = failure;
        Self {
            predictor: failure.predictor.clone(),
            cell: cell_name(failure.family, failure.frequency_hz)
                + &at_noise(failure.position_noise_rad),
            text: format!("no answer to {scenarios} scenarios, first trajectory {first}: {reason}"),
        }
    }
}

impl LatencyRow {
    fn of(predictor: &PredictorInfo) -> Option<Self> {
        let latency = predictor.latency.as_ref()?;
        Some(Self {
            predictor: predictor.name.clone(),
            median_ms: text::value(latency.median_ms),
            p99_ms: text::value(latency.p99_ms),
        })
    }
}

/// The values of `found` in the order of `predictors`. The best one is marked, among predictors
/// that do not see the future.
fn row(predictors: &[PredictorInfo], found: &[PredictorSummary]) -> Vec<MeanWithInterval> {
    let of = |predictor: &PredictorInfo| found.iter().find(|rmse| rmse.predictor == predictor.name);
    let honest = || predictors.iter().filter(|info| !info.sees_the_future());
    let lowest =
        honest().filter_map(of).map(|rmse| rmse.interval.mean).fold(f64::INFINITY, f64::min);
    predictors
        .iter()
        .map(|predictor| match of(predictor) {
            Some(rmse) => MeanWithInterval {
                mean: text::degrees(rmse.interval.mean),
                interval: text::interval(rmse.interval),
                best: rmse.interval.mean <= lowest && !predictor.sees_the_future(),
            },
            None => {
                MeanWithInterval { mean: "–".to_owned(), interval: String::new(), best: false }
            }
        })
        .collect()
}

fn transpose(
    predictors: &[PredictorInfo],
    by_group: Vec<Vec<MeanWithInterval>>,
) -> Vec<SummaryRow> {
    let mut rows: Vec<SummaryRow> = predictors
        .iter()
        .map(|info| SummaryRow {
            predictor: info.name.clone(),
            remark: remark(info),
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

fn remark(predictor: &PredictorInfo) -> String {
    let told = predictor.told.as_ref();
    let remark = match predictor.kind {
        PredictorKind::Predictions => {
            let file = predictor.file.map(|file| file.short()).unwrap_or_default();
            return format!(
                "predictions of file {file}; nobody can tell whether it saw the horizon"
            );
        }
        PredictorKind::Baseline => {
            return told.map_or("baseline".to_owned(), |told| format!("baseline, told {told}"));
        }
        PredictorKind::Checkpoint if !predictor.sees_the_future() => "",
        PredictorKind::Checkpoint if predictor.normalization == Some(Normalization::PaperLeaky) => {
            "sees the future: paper-leaky normalization"
        }
        PredictorKind::Checkpoint => "sees the future: starts with the truth",
    };
    remark.to_owned()
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
            interval: text::signed_interval(paired.difference_deg),
            verdict,
        }
    }
}

/// The key result of an evaluation in a line.
pub fn headline(headline: &Headline) -> String {
    let error =
        |error: &MeanError| format!("{} {}°", error.predictor, text::degrees(error.rmse_deg));
    let best: Vec<String> = headline.best.iter().map(error).collect();
    match best.as_slice() {
        [] => String::new(),
        best => format!("{}: {}", headline.group, best.join(" · ")),
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
            "context": 320, "horizon": 80, "rate_hz": 60.0, "bootstrap": {}, "samples": 1,
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
        let headline = headline(&Headline::of(&report()));
        assert_eq!(headline, "in distribution: robomorph 1.25° · hold-last 3.00°");
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
    fn jumps_rollouts_and_data_never_seen_are_shown_where_they_were_measured() {
        let mut report = report();
        let view = ReportView::new(&report);
        assert!(view.rollouts.is_empty() && view.warnings.is_empty(), "an older report");

        let interval = |mean: f64| Some(Interval { mean, low: mean, high: mean });
        report.groups[0].scores = vec![wire::PredictorScores {
            predictor: "robomorph".to_owned(),
            first_sample_deg: interval(0.35),
            jump_deg: interval(0.19),
            seam_jump_deg: interval(0.39),
            ..wire::PredictorScores::default()
        }];
        report.groups[0].rollouts = vec![wire::RolloutSummary {
            predictor: "robomorph".to_owned(),
            left_limits: None,
            diverged: 0.25,
        }];
        let range = spec::Range::new(-2.8, 2.8);
        let kind = wire::WarningKind::TorqueRange;
        report.warnings = vec![Warning::outside(kind, 2, -30.1, range, 40).of("robomorph")];
        let view = ReportView::new(&report);
        let [row] = &view.rollouts[..] else { panic!("one predictor of one group") };
        assert_eq!(
            [&row.first_sample, &row.jump, &row.seam_jump, &row.left_limits, &row.diverged],
            ["0.35", "0.19", "0.39", "–", "25.0 %"]
        );
        assert_eq!(
            view.warnings,
            ["robomorph: u of joint 2 reaches -30.1 N·m; the checkpoint was trained on -2.80 to \
              2.80 N·m (40 of 100 scenarios)"]
        );
    }

    #[test]
    fn a_difference_is_only_called_one_when_its_interval_excludes_zero() {
        let verdicts: Vec<&str> =
            ReportView::new(&report()).paired.iter().map(|row| row.verdict).collect();
        assert_eq!(verdicts, ["better", "not told apart", "worse"]);
    }
}
