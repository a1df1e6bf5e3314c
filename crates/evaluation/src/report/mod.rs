//! Combines the cells of an evaluation into its [`wire::Report`].

mod by_shift;
mod comparisons;
mod replications;
mod scores;
mod shift;
mod summary;

pub use shift::{trained_on, trained_on_together};
pub use summary::{Setting, summarize};

#[cfg(test)]
pub(crate) mod tests {
    use series::{Series, Shape};
    use spec::{Bootstrap, Family, Range, SamplerKind};
    use wire::{
        FailureSummary, PredictorInfo, PredictorKind, PredictorSummary, Report, SamplingInfo,
        TrainedOn, Warning, WorstCase,
    };

    use super::comparisons::paired_difference;
    use super::*;
    use crate::{
        CellResult, ErrorHorizon, EvaluationError, Failure, HoldLast, Predictor, Scoring,
        evaluate_cell,
    };

    /// A predictor with a name and a kind only.
    pub(crate) fn named(name: &str, kind: PredictorKind) -> PredictorInfo {
        let name = name.to_owned();
        PredictorInfo {
            name,
            kind,
            told: None,
            digest: None,
            file: None,
            replicates: None,
            normalization: None,
            sampling: None,
            latency: None,
        }
    }

    pub(crate) fn cell(cell: usize, frequency_hz: f64, model: f64, baseline: f64) -> CellResult {
        let errors = |predictor: &str, value: f64| crate::PredictorErrors {
            predictor: predictor.to_owned(),
            rmse_deg: vec![Some(value - 0.1), Some(value + 0.1)],
            ..crate::PredictorErrors::default()
        };
        CellResult {
            cell,
            family: Some(Family::Multisine),
            frequency_hz: Some(frequency_hz),
            position_noise_rad: 0.0,
            first: 2 * cell as u64,
            joints: 7,
            horizons_s: Vec::new(),
            predictors: vec![errors("baseline", baseline), errors("model", model)],
            measured_jitter_deg: None,
            measured_left_limits: None,
            within_torque_limits: Vec::new(),
            warnings: Vec::new(),
        }
    }

    pub(crate) fn setting() -> Setting {
        let trained_on = TrainedOn {
            family: Family::Multisine,
            frequency_hz: Range::new(0.15, 0.15),
            amplitude: None,
        };
        Setting {
            context: 320,
            horizon: 80,
            rate_hz: 60.0,
            samples: 1,
            given: spec::Given::Torques,
            data_noise: None,
            seed: Some(7),
            bootstrap: Bootstrap::default(),
            excitation: None,
            predictors: vec![
                named("baseline", PredictorKind::Baseline),
                named("model", PredictorKind::Checkpoint),
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
    fn levels_of_noise_are_groups_apart() {
        let noisy = |index, frequency_hz, model| CellResult {
            position_noise_rad: 1e-3,
            ..cell(index, frequency_hz, model, 4.0)
        };
        let results = [
            cell(0, 0.15, 1.0, 2.0),
            cell(1, 0.3, 5.0, 4.0),
            noisy(2, 0.15, 2.0),
            noisy(3, 0.3, 6.0),
        ];
        let report = report(&results).unwrap();
        let names: Vec<&str> = report.groups.iter().map(|group| group.name.as_str()).collect();
        let expected = [
            "in distribution",
            "out of distribution",
            "in distribution at 0.001 rad",
            "out of distribution at 0.001 rad",
        ];
        assert_eq!(names, expected);
        let model = |group: usize| report.groups[group].rmse_deg[1].interval.mean.round();
        assert_eq!([model(0), model(1), model(2), model(3)], [1.0, 5.0, 2.0, 6.0]);
        assert_eq!(report.groups[2].position_noise_rad, 1e-3);
        assert_eq!(report.cells[3].position_noise_rad, 1e-3);
        let levels = |group: &str| {
            let of_group = report.paired.iter().filter(|paired| paired.group == group);
            of_group.map(|paired| paired.position_noise_rad).collect::<Vec<_>>()
        };
        assert_eq!((levels(expected[0]), levels(expected[3])), (vec![0.0], vec![1e-3]));
    }

    #[test]
    fn paired_differences_cancel_what_is_common_to_a_scenario() {
        let report = report(&[cell(0, 0.15, 1.0, 2.0)]).unwrap();
        let difference = &report.paired[0].difference_deg;
        assert!((difference.low + 1.0).abs() < 1e-9 && (difference.high + 1.0).abs() < 1e-9);
    }

    #[test]
    fn the_error_of_the_first_sample_is_that_of_the_first_step() {
        const JOINTS: usize = 7;
        let y: Vec<f32> = (0..3 * 60 * JOINTS).map(|k| (0.01 * k as f32).sin()).collect();
        let shape = Shape { robots: 3, samples: 60, joints: JOINTS };
        let scenarios = Series::new(shape, 60.0, y.clone(), y).unwrap();
        let scoring = Scoring {
            pre_roll: 0,
            context: 20,
            samples: 1,
            band_edge_hz: None,
            given: spec::Given::Torques,
            limits_rad: vec![Range::new(-2.0, 2.0); JOINTS],
            horizons: ErrorHorizon::all(&[1.0 / 60.0, 0.5], 60.0, 40),
        };
        let predictors: [Box<dyn Predictor>; 1] = [Box::new(HoldLast)];
        let cell = CellResult {
            horizons_s: scoring.horizons.iter().map(|horizon| horizon.seconds).collect(),
            predictors: evaluate_cell(&scenarios.view(), &scoring, &predictors),
            warnings: vec![Warning::no_motion(1e-3, 2)],
            ..cell(0, 0.15, 1.0, 2.0)
        };
        let predictors = vec![named("hold-last", PredictorKind::Baseline)];
        let unmeasured = CellResult { cell: 1, horizons_s: Vec::new(), ..cell.clone() };
        let report = summarize(Setting { predictors, ..setting() }, &[cell, unmeasured]).unwrap();
        let [over_one, over_half] = &report.cells[0].scores[0].horizon_errors[..] else {
            panic!("two horizons")
        };
        assert_eq!((over_one.seconds, over_half.seconds), (1.0 / 60.0, 0.5));
        assert!(over_one.rmse_deg.mean < over_half.rmse_deg.mean);
        assert_eq!(report.groups[0].scores[0].horizon_errors, [], "a cell has none");
        let group = &report.groups[0];
        let first = group.scores[0].first_sample_deg.unwrap();
        assert!((first.mean - group.scores[0].step_rmse_deg[0]).abs() < 1e-5, "{first:?}");
        assert!(first.low <= first.mean && first.mean <= first.high, "{first:?}");
        assert_eq!(group.scores[0].seam_jump_deg, None);
        let rollouts = &group.rollouts[0];
        assert_eq!((rollouts.left_limits, rollouts.diverged), (Some(0.0), 0.0));
        assert_eq!((report.warnings.len(), report.scenarios()), (1, 6));
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
            position_noise_rad: 0.0,
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
            ..named(&format!("{start} {steps}"), PredictorKind::Checkpoint)
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
            report.paired.iter().map(|pair| [&pair.predictor[..], &pair.against]).collect();
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
}
