use wire::Interval;

use super::*;
use crate::example;

fn lines(table: &Table) -> Vec<String> {
    table.render().lines().map(str::to_owned).collect()
}

#[test]
fn errors_over_parts_of_the_horizon_are_columns_and_older_reports_have_no_such_table() {
    let mut report = example();
    assert!(over_horizons(&report).rows.is_empty());
    let error = |seconds, mean| HorizonError {
        seconds,
        rmse_deg: Interval { mean, low: mean, high: mean },
    };
    report.groups[1].scores = vec![PredictorScores {
        predictor: "robomorph".to_owned(),
        horizon_errors: vec![error(0.1, 0.0123), error(4.0 / 3.0, 2.5)],
        ..PredictorScores::default()
    }];
    assert_eq!(
        lines(&over_horizons(&report).means()),
        [
            "predictor  scenarios            0.1 s  1.333 s",
            "robomorph  out of distribution  0.012     2.50",
        ]
    );
}

fn interval(mean: f64) -> Option<Interval> {
    Some(Interval { mean, low: mean, high: mean })
}

#[test]
fn in_and_out_of_distribution_are_apart_and_every_predictor_has_a_row() {
    assert_eq!(
        lines(&errors(&example())),
        [
            "predictor          in distribution (100 scenarios)  out of distribution (100 scenarios)",
            "hold-last                        8.00 [7.50, 8.50]                    8.00 [7.50, 8.50]",
            "damped-integrator                2.00 [1.50, 2.50]                    2.00 [1.50, 2.50]",
            "robomorph                        2.50 [2.00, 3.00]                    2.50 [2.00, 3.00]",
        ]
    );
}

#[test]
fn the_best_among_equals_is_marked_unless_it_sees_the_future() {
    let mut report = example();
    let best = |report: &Report| -> Vec<Vec<bool>> {
        errors(report).rows.iter().map(|row| row.iter().map(Cell::is_best).collect()).collect()
    };
    // The only model has no equals, so two baselines compete.
    assert_eq!(best(&report), [[false; 3], [false, true, true], [false; 3]]);
    for group in &mut report.groups {
        let mut other = group.rmse_deg[2].clone();
        (other.predictor, other.interval.mean) = ("cdt".to_owned(), 3.0);
        group.rmse_deg.push(other);
    }
    report.groups[1].rmse_deg[3].interval.mean = 1.0;
    let other = PredictorInfo { name: "cdt".to_owned(), ..report.predictors[2].clone() };
    report.predictors.push(other);
    let models = best(&report)[2..].to_vec();
    assert_eq!(models, [[false, true, false], [false, false, true]]);
    report.predictors[3].normalization = Some(Normalization::PaperLeaky);
    assert!(best(&report)[2..].iter().flatten().all(|is_best| !is_best));
}

#[test]
fn levels_of_noise_stand_beside_each_other() {
    let mut report = example();
    let mut noisy = report.groups[0].clone();
    noisy.name = "in distribution at 0.001 rad".to_owned();
    noisy.position_noise_rad = 1e-3;
    report.groups.push(noisy);
    let cells =
        report.cells.iter().map(|cell| CellSummary { position_noise_rad: 1e-3, ..cell.clone() });
    let noisy: Vec<CellSummary> = cells.collect();
    report.cells.extend(noisy);
    let heading = &lines(&errors(&report))[0];
    assert!(heading.ends_with("  in distribution at 0.001 rad"), "{heading}");
    let titles: Vec<String> = by_frequency(&report).into_iter().map(|table| table.title).collect();
    let title = "RMSE in degrees by frequency in Hz: multisine";
    assert_eq!(titles, [title.to_owned(), format!("{title} at 0.001 rad")]);
}

#[test]
fn prior_knowledge_is_the_last_column() {
    let mut report = example();
    report.predictors[1].told = Some("the nominal damping".to_owned());
    let lines = lines(&errors(&report));
    assert!(lines[0].ends_with("  prior knowledge"), "{lines:?}");
    assert!(lines[2].ends_with("2.00 [1.50, 2.50]  the nominal damping"), "{lines:?}");
    assert!(lines[3].ends_with("2.50 [2.00, 3.00]  -"), "{lines:?}");
}

#[test]
fn a_frequency_in_distribution_is_marked() {
    let table = by_frequency(&example()).remove(0);
    assert!(table.note.starts_with('*'));
    let lines = lines(&table.means());
    assert_eq!(lines[0], "predictor          0.05  0.15*");
    assert_eq!(lines[1], "hold-last          8.00   8.00");
}

#[test]
fn a_predictor_that_saw_the_future_is_labelled_in_the_table() {
    let mut report = example();
    report.predictors[2].sampling = Some(wire::SamplingInfo {
        curve: "robomorph ddpm oracle".to_owned(),
        kind: spec::SamplerKind::Ddpm,
        steps: 5,
        start: spec::Start::Oracle,
    });
    let text = errors(&report).render();
    assert!(text.contains("robomorph (leak: starts with the truth)"), "{text}");
    assert!(text.contains("  the horizon: starts with the truth"), "{text}");
}

#[test]
fn measures_are_shown_where_they_were_measured() {
    let mut report = example();
    assert!(continuity(&report).rows.is_empty(), "an older report");
    report.groups[0].scores = vec![PredictorScores {
        predictor: "robomorph".to_owned(),
        first_sample_deg: interval(0.35),
        jump_deg: interval(0.19),
        largest_jump_deg: interval(0.8),
        crps_deg: interval(0.5),
        ..PredictorScores::default()
    }];
    report.groups[0].rollouts = vec![RolloutSummary {
        predictor: "robomorph".to_owned(),
        left_limits: Some(0.015),
        diverged: 0.0,
    }];
    assert_eq!(
        lines(&continuity(&report)),
        [
            "predictor  scenarios        first sample, °  jump, °  mean largest, °  left limits  diverged",
            "robomorph  in distribution             0.35     0.19             0.80        1.5 %     0.0 %",
        ]
    );
    assert_eq!(
        lines(&samples(&report)),
        ["predictor  scenarios        CRPS, °", "robomorph  in distribution     0.50"]
    );
    let titles: Vec<String> =
        tables(&report, |_| None).into_iter().map(|table| table.title).collect();
    assert!(!titles.contains(&"Jitter".to_owned()), "{titles:?}");
}

#[test]
fn the_terminal_has_crps_and_coverage_where_there_were_samples() {
    let mut report = example();
    assert!(!crate::text(&report).contains("Samples as a distribution"));
    let mean = |mean: f64| Interval { mean, low: mean, high: mean };
    report.groups[0].scores = vec![PredictorScores {
        predictor: "robomorph".to_owned(),
        crps_deg: interval(0.5),
        intervals: vec![wire::IntervalSummary {
            nominal: 0.9,
            coverage: mean(0.87),
            width_deg: mean(2.5),
            joint_coverage: Vec::new(),
            step_coverage: Vec::new(),
        }],
        ..PredictorScores::default()
    }];
    let text = crate::text(&report);
    for part in ["Samples as a distribution", "CRPS, °", "0.50", "90 %: 87 % inside, 2.50° wide"]
    {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn a_measure_says_what_it_means() {
    let first = PredictorScores::measures().next().unwrap();
    assert_eq!(
        first.about,
        "Error of the first sample of the horizon: root mean square over scenarios and joints."
    );
    for about in PredictorScores::measures().map(|measure| measure.about) {
        assert!(about.ends_with('.'), "{about}");
    }
}

#[test]
fn a_difference_is_only_called_one_when_its_interval_excludes_zero() {
    let rows = paired(&example()).rows;
    let verdicts: Vec<String> = rows.iter().map(|row| row[4].to_string()).collect();
    assert_eq!(verdicts, ["better", "not clear", "better", "worse"]);
    assert_eq!(rows[1][3].to_string(), "+0.20 [-0.30, +0.70]");
}

#[test]
fn the_headline_puts_the_best_checkpoint_beside_the_best_baseline() {
    let mut report = example();
    let headline = |report: &Report| crate::headline(&wire::Headline::of(report));
    assert_eq!(
        headline(&report),
        "in distribution: robomorph 2.50° (not clearly different) · damped-integrator 2.00°"
    );
    report.groups[0].scenarios = 4;
    assert_eq!(
        headline(&report),
        "in distribution: robomorph 2.50° (too few scenarios to tell) · damped-integrator 2.00°"
    );
    report.paired.clear();
    let plain = "in distribution: robomorph 2.50° · damped-integrator 2.00°";
    assert_eq!(headline(&report), plain);
}

#[test]
fn an_older_headline_has_no_differences() {
    let older = serde_json::json!({"group": "all scenarios", "best": [
        {"predictor": "cdt", "rmse_deg": 1.0}, {"predictor": "hold-last", "rmse_deg": 2.0}]});
    let headline: wire::Headline = serde_json::from_value(older).unwrap();
    assert_eq!(crate::headline(&headline), "all scenarios: cdt 1.00° · hold-last 2.00°");
}
