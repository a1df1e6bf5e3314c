//! What an evaluation found: every number with its interval, in and out of distribution apart.

mod scores;
mod summary;

use serde::{Deserialize, Serialize};
use spec::{Bootstrap, Digest, Family, JOINTS, Normalization, Range, SamplerKind, Start};

use crate::Interval;

pub use summary::{Setting, paired_difference, summarize};

/// The result of an evaluation, as it is stored, shown and downloaded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Samples every predictor was given, and samples it was asked for.
    pub context: u32,
    pub horizon: u32,
    pub rate_hz: f64,
    pub bootstrap: Bootstrap,
    pub predictors: Vec<PredictorInfo>,
    /// Samples each predictor that has several was asked for.
    #[serde(default = "one")]
    pub samples: u32,
    /// What the checkpoints were trained on; cells inside are "in distribution".
    pub in_distribution: Vec<TrainedOn>,
    pub cells: Vec<CellSummary>,
    pub groups: Vec<GroupSummary>,
    pub paired: Vec<PairedDifference>,
    /// Predictors that had no answer to some scenarios of a cell. They have no mean over that cell,
    /// nor over a group with it.
    #[serde(default)]
    pub failures: Vec<FailureSummary>,
    /// Of every predictor, the scenarios with the largest errors, the largest first.
    #[serde(default)]
    pub worst: Vec<WorstCase>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictorInfo {
    pub name: String,
    pub kind: PredictorKind,
    /// Digest of the training's spec.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<Digest>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normalization: Option<Normalization>,
    /// Of a denoiser: how it was sampled.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampling: Option<SamplingInfo>,
    /// Of one prediction at batch 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency: Option<Latency>,
}

const fn one() -> u32 {
    1
}

/// How a denoiser was sampled. Predictors that differ in nothing but `steps` are one curve in
/// figures over steps, which is named `curve`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SamplingInfo {
    pub curve: String,
    pub kind: SamplerKind,
    /// Passes through the network.
    pub steps: u32,
    #[serde(default)]
    pub start: Start,
}

impl PredictorInfo {
    /// Whether something of what it is to predict was told to it.
    pub fn sees_the_future(&self) -> bool {
        self.normalization == Some(Normalization::PaperLeaky)
            || self.sampling.as_ref().is_some_and(|sampling| sampling.start == Start::Oracle)
    }
}

/// Times of one prediction at batch 1, ms. They are the machine's as much as the predictor's: unlike
/// all else in a report, they are not the same when it is made again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Latency {
    pub median_ms: f64,
    pub p99_ms: f64,
    /// Predictions that were timed.
    #[serde(default)]
    pub repeats: usize,
    /// Threads that computed.
    pub threads: usize,
    #[serde(default)]
    pub device: String,
    /// What else ran: the machine's mean number of running threads in the minute before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub load: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PredictorKind {
    Baseline,
    Checkpoint,
}

/// Master frequencies of one family that training drew from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainedOn {
    pub family: Family,
    pub frequency_hz: Range,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellSummary {
    /// `None` of data without a frequency grid, as the frequency.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    pub in_distribution: bool,
    pub scenarios: usize,
    pub rmse_deg: Vec<PredictorSummary>,
    #[serde(default)]
    pub scores: Vec<PredictorScores>,
    /// What the measured motions themselves have above the band that jitter is measured from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_jitter_deg: Option<f64>,
}

/// Mean RMSE over scenarios, in degrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictorSummary {
    pub predictor: String,
    #[serde(flatten)]
    pub interval: Interval,
}

/// All cells in distribution, all out of it, or those of which that cannot be said.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroupSummary {
    pub name: String,
    pub scenarios: usize,
    pub rmse_deg: Vec<PredictorSummary>,
    #[serde(default)]
    pub scores: Vec<PredictorScores>,
}

/// All else that was measured of one predictor on some cells: means over scenarios and joints,
/// with their intervals. What was not measured is missing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PredictorScores {
    pub predictor: String,
    /// Of each joint, mean over scenarios.
    pub joint_rmse_deg: [f64; JOINTS],
    /// Of each step of the horizon, root mean square over scenarios and joints.
    pub step_rmse_deg: Vec<f64>,
    /// Root mean square of what a prediction has above the signal's band.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter_deg: Option<Interval>,
    /// The same after a zero-phase low-pass, and the RMSE after it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoothed_jitter_deg: Option<Interval>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoothed_rmse_deg: Option<Interval>,
    /// Of the mean of the samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean_rmse_deg: Option<Interval>,
    /// Fair estimate from the samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crps_deg: Option<Interval>,
    /// Fair estimate from the samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub energy_score_deg: Option<Interval>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub intervals: Vec<IntervalSummary>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub calibration: Vec<Calibration>,
}

/// Central intervals of one probability.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IntervalSummary {
    pub nominal: f64,
    /// Share of measured positions inside.
    pub coverage: Interval,
    pub width_deg: Interval,
}

/// How much central intervals of one probability hold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    pub nominal: f64,
    pub coverage: f64,
}

/// RMSE of `predictor` minus that of `against` on the same scenarios; below 0 is better.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PairedDifference {
    pub group: String,
    pub predictor: String,
    pub against: String,
    pub difference_deg: Interval,
}

/// A predictor without an answer to some scenarios of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FailureSummary {
    pub predictor: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// How many.
    pub scenarios: usize,
    /// Index of the first in the dataset.
    pub first: u64,
    pub reason: String,
}

/// A scenario to look at: with the spec of its dataset, its index makes it again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorstCase {
    pub predictor: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Index in the dataset.
    pub trajectory: u64,
    /// Of the dataset's simulation; none for recordings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    pub rmse_deg: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CellResult, EvaluationError, Failure};

    impl PredictorInfo {
        /// One of which no more is known.
        pub(crate) fn named(name: &str, kind: PredictorKind) -> Self {
            let name = name.to_owned();
            Self { name, kind, digest: None, normalization: None, sampling: None, latency: None }
        }
    }

    fn cell(cell: usize, frequency_hz: f64, model: f64, baseline: f64) -> CellResult {
        let errors = |predictor: &str, value: f64| crate::PredictorErrors {
            predictor: predictor.to_owned(),
            rmse_deg: vec![Some(value - 0.1), Some(value + 0.1)],
            ..crate::PredictorErrors::default()
        };
        CellResult {
            cell,
            family: Some(Family::Multisine),
            frequency_hz: Some(frequency_hz),
            first: 2 * cell as u64,
            predictors: vec![errors("baseline", baseline), errors("model", model)],
            measured_jitter_deg: None,
        }
    }

    fn setting() -> Setting {
        let trained_on =
            TrainedOn { family: Family::Multisine, frequency_hz: Range::new(0.15, 0.15) };
        Setting {
            context: 320,
            horizon: 80,
            rate_hz: 60.0,
            samples: 1,
            seed: Some(7),
            bootstrap: Bootstrap::default(),
            predictors: vec![
                PredictorInfo::named("baseline", PredictorKind::Baseline),
                PredictorInfo::named("model", PredictorKind::Checkpoint),
            ],
            trained_on: vec![vec![trained_on]],
        }
    }

    fn report(results: &[CellResult]) -> Result<Report, EvaluationError> {
        summarize(setting(), results)
    }

    #[test]
    fn in_and_out_of_distribution_are_kept_apart() {
        let results = [cell(0, 0.1 + 0.05, 1.0, 2.0), cell(1, 0.3, 5.0, 4.0)];
        let report = report(&results).unwrap();
        let mean = |group: usize, predictor: usize| {
            (report.groups[group].rmse_deg[predictor].interval.mean * 1e6).round() / 1e6
        };
        assert_eq!(report.groups[0].name, "in distribution");
        assert_eq!([mean(0, 0), mean(0, 1), mean(1, 0), mean(1, 1)], [2.0, 1.0, 4.0, 5.0]);
    }

    #[test]
    fn paired_differences_cancel_what_is_common_to_a_scenario() {
        let report = report(&[cell(0, 0.15, 1.0, 2.0)]).unwrap();
        let difference = &report.paired[0].difference_deg;
        assert!((difference.low + 1.0).abs() < 1e-9 && (difference.high + 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_missing_cell_is_an_error() {
        let error = report(&[cell(1, 0.15, 1.0, 2.0)]).unwrap_err();
        assert!(matches!(error, EvaluationError::MissingCell(0)));
    }

    #[test]
    fn a_report_reads_back_from_its_json() {
        let report = report(&[cell(0, 0.15, 1.0, 2.0)]).unwrap();
        let text = serde_json::to_string(&report).unwrap();
        assert_eq!(serde_json::from_str::<Report>(&text).unwrap(), report);
    }

    #[test]
    fn a_predictor_without_some_answers_has_no_mean_but_a_reported_failure() {
        let mut results = [cell(0, 0.15, 1.0, 2.0), cell(1, 0.3, 5.0, 4.0)];
        let broken = &mut results[1].predictors[1];
        broken.rmse_deg[1] = None;
        let reason = "a value that is not finite".to_owned();
        broken.failure = Some(Failure { scenarios: 1, first: 1, reason: reason.clone() });
        let report = report(&results).unwrap();
        let names = |rmse: &[PredictorSummary]| -> Vec<String> {
            rmse.iter().map(|rmse| rmse.predictor.clone()).collect()
        };
        assert_eq!(names(&report.groups[0].rmse_deg), ["baseline", "model"]);
        assert_eq!(names(&report.groups[1].rmse_deg), ["baseline"]);
        assert_eq!(names(&report.cells[1].rmse_deg), ["baseline"]);
        let expected = FailureSummary {
            predictor: "model".to_owned(),
            family: Some(Family::Multisine),
            frequency_hz: Some(0.3),
            scenarios: 1,
            first: 3,
            reason,
        };
        assert_eq!(report.failures, [expected]);
        assert!(report.paired.iter().all(|paired| paired.group == "in distribution"));
    }

    #[test]
    fn short_chains_are_compared_with_the_longest_from_noise() {
        let run = |start, steps| PredictorInfo {
            sampling: Some(SamplingInfo {
                curve: format!("model ddpm {start}"),
                kind: SamplerKind::Ddpm,
                steps,
                start,
            }),
            ..PredictorInfo::named(&format!("{start} {steps}"), PredictorKind::Checkpoint)
        };
        let (cold, shifted) = (spec::Start::Cold, spec::Start::Shifted);
        let runs = [run(cold, 5), run(cold, 100), run(shifted, 5), run(shifted, 20)];
        let mut result = cell(0, 0.15, 1.0, 2.0);
        let errors = result.predictors.pop().unwrap();
        result.predictors = runs
            .iter()
            .map(|run| crate::PredictorErrors { predictor: run.name.clone(), ..errors.clone() })
            .collect();
        let setting = Setting { predictors: runs.to_vec(), ..setting() };
        let report = summarize(setting, &[result]).unwrap();
        let pairs: Vec<[&str; 2]> =
            report.paired.iter().map(|it| [&it.predictor[..], &it.against]).collect();
        assert!(pairs.contains(&["shifted 5", "cold 100"]), "{pairs:?}");
        assert!(pairs.contains(&["shifted 20", "cold 100"]), "{pairs:?}");
        assert!(!pairs.contains(&["shifted 20", "cold 5"]), "{pairs:?}");
    }

    #[test]
    fn the_worst_cases_can_be_made_again() {
        let report = report(&[cell(0, 0.15, 1.0, 2.0), cell(1, 0.3, 5.0, 4.0)]).unwrap();
        let of_model: Vec<&WorstCase> =
            report.worst.iter().filter(|worst| worst.predictor == "model").collect();
        let trajectories: Vec<u64> = of_model.iter().map(|worst| worst.trajectory).collect();
        assert_eq!(trajectories, [3, 2, 1, 0]);
        assert_eq!((of_model[0].seed, of_model[0].frequency_hz), (Some(7), Some(0.3)));
    }

    #[test]
    fn any_two_predictors_can_be_compared_on_the_same_scenarios() {
        let cells = [cell(0, 0.15, 1.0, 2.0), cell(1, 0.3, 5.0, 4.0)];
        let cells: Vec<&CellResult> = cells.iter().collect();
        let bootstrap = Bootstrap::default();
        let found = paired_difference(&cells, "baseline", "model", bootstrap).unwrap();
        assert!(found.mean.abs() < 1e-9, "{found:?}");
        assert_eq!(paired_difference(&cells, "baseline", "nobody", bootstrap), None);
    }

    #[test]
    fn a_report_of_the_first_version_is_still_read() {
        let text = r#"{"context": 320, "horizon": 80, "rate_hz": 60.0,
            "bootstrap": {"resamples": 2000, "seed": 0},
            "predictors": [{"name": "hold-last", "kind": "baseline"}],
            "in_distribution": [],
            "cells": [{"family": "chirp", "frequency_hz": 0.3, "in_distribution": false,
                       "scenarios": 2, "rmse_deg":
                       [{"predictor": "hold-last", "mean": 1.0, "low": 0.9, "high": 1.1}]}],
            "groups": [], "paired": []}"#;
        let report: Report = serde_json::from_str(text).unwrap();
        assert_eq!(report.cells[0].rmse_deg[0].interval.high, 1.1);
    }
}
