//! The report of an evaluation: its tables, and sentences about its setting and its failures.

use spec::{Family, Given, Normalization};
use wire::{
    CellSummary, FailureSummary, GroupSummary, HorizonError, Latency, PredictorInfo,
    PredictorScores, PredictorSummary, Report, RolloutSummary, Topic, Unit, WorstCase, at_noise,
};

use crate::numbers::{count, degrees, value};
use crate::{Align, Cell, ComparisonOutcome, Table, TableOf};

mod seeds;
mod skill;
mod standing;

pub(crate) use seeds::over_seeds;
pub(crate) use skill::skill;
use standing::Standing;
pub use standing::{answer, answer_for, ranked};

/// All tables with rows, in the order of the page. `view` has the page that shows a scenario.
pub fn tables(report: &Report, view: impl Fn(&WorstCase) -> Option<String>) -> Vec<Table> {
    let first = [
        errors(report),
        over_horizons(report),
        over_seeds(report),
        skill(report),
        continuity(report),
        paired(report),
        torques(report),
        samples(report),
        jitter(report),
        latencies(report),
        worst(report, view),
    ];
    let tables = first.into_iter().chain(by_frequency(report));
    tables.filter(|table| !table.rows.is_empty()).collect()
}

/// The question of the evaluation, in a sentence.
pub fn setting(report: &Report) -> String {
    let seconds = |samples: u32| value(f64::from(samples) / report.rate_hz);
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
        let [position, torque] = [noise.position_rad, noise.torque_nm].map(value);
        format!(" The data's own noise has standard deviations of {position} rad and {torque} N·m.")
    });
    let given = match report.given {
        Given::Torques => "",
        Given::References => ", and the references of a controller that it does not know,",
    };
    format!(
        "Every predictor is given {} samples ({} s){given} and predicts the next {} ({} s) at {} Hz; {trained}.{noise}",
        report.context,
        seconds(report.context),
        report.horizon,
        seconds(report.horizon),
        report.rate_hz,
    )
}

/// A sentence for each predictor and cell without some answers.
pub fn failures(report: &Report) -> Vec<String> {
    let sentence = |failure: &FailureSummary| {
        let FailureSummary { predictor, scenarios, first, reason, .. } = failure;
        let cell = cell_name(failure.family, failure.frequency_hz, failure.position_noise_rad);
        format!(
            "{predictor}, {cell}: no answer to {scenarios} scenarios, first trajectory {first}: {reason}"
        )
    };
    report.failures.iter().map(sentence).collect()
}

/// Every predictor's RMSE in and out of distribution, and its prior knowledge.
pub(crate) fn errors(report: &Report) -> Table {
    let heading = |group: &GroupSummary| {
        // All levels of noise use the same scenarios.
        let is_noisy = group.position_noise_rad > 0.0;
        let scenarios = format!(" ({} scenarios)", count(group.scenarios));
        group.name.clone() + if is_noisy { "" } else { &scenarios }
    };
    let predictors = TableOf::new(&report.predictors).text("predictor", |info| label(info));
    let with_groups = report.groups.iter().fold(predictors, |table, group| {
        let cell = rmse(report, &group.rmse_deg);
        table.number(&heading(group), |info| cell(info))
    });
    with_groups
        .text("prior knowledge", |info| prior_knowledge(info))
        .titled("RMSE in degrees, with 95 % intervals", "")
        .without_empty_columns()
}

/// Every predictor's RMSE over the first parts of the horizon. Without rows in older reports.
pub(crate) fn over_horizons(report: &Report) -> Table {
    let rows: Vec<Scored<'_>> =
        scored(report).filter(|row| !row.horizon_errors().is_empty()).collect();
    let first = rows.first().map_or(&[][..], Scored::horizon_errors);
    let seconds: Vec<f64> = first.iter().map(|error| error.seconds).collect();
    let predictors = TableOf::new(rows)
        .text("predictor", |row| label(row.predictor))
        .text("scenarios", |row| row.group.name.as_str());
    let with_seconds = seconds.iter().enumerate().fold(predictors, |table, (k, &seconds)| {
        let cell = |error: &HorizonError| Cell::Interval(error.rmse_deg, Unit::Degrees);
        table.number(&format!("{} s", value(seconds)), |row| row.horizon_errors().get(k).map(cell))
    });
    with_seconds.titled("RMSE in degrees over the first part of the horizon", "")
}

/// Every predictor's RMSE at every frequency, a table for each family and level of noise.
pub(crate) fn by_frequency(report: &Report) -> Vec<Table> {
    let mut levels: Vec<f64> = Vec::new();
    for cell in &report.cells {
        if !levels.contains(&cell.position_noise_rad) {
            levels.push(cell.position_noise_rad);
        }
    }
    let of_family = |family: Family, level: f64| {
        let is_here =
            |cell: &&CellSummary| cell.family == Some(family) && cell.position_noise_rad == level;
        let cells: Vec<&CellSummary> = report.cells.iter().filter(is_here).collect();
        let predictors = TableOf::new(&report.predictors).text("predictor", |info| label(info));
        let table = cells.iter().fold(predictors, |table, cell| {
            let mark = if cell.in_distribution { "*" } else { "" };
            let heading = format!("{}{mark}", cell.frequency_hz.unwrap_or_default());
            let about = format!("{} scenarios", count(cell.scenarios));
            let rmse = rmse(report, &cell.rmse_deg);
            table.column(&heading, Align::Right, &about, |info| rmse(info))
        });
        let is_marked = cells.iter().any(|cell| cell.in_distribution);
        let note = if is_marked { "* all checkpoints were trained at this frequency" } else { "" };
        let title = format!("RMSE in degrees by frequency in Hz: {family}{}", at_noise(level));
        (!cells.is_empty()).then(|| table.titled(title, note))
    };
    let of_families =
        |level: f64| Family::ALL.into_iter().filter_map(move |family| of_family(family, level));
    levels.into_iter().flat_map(of_families).collect()
}

/// The RMSE of each predictor over some scenarios. The lowest of several equals is marked.
fn rmse<'a>(
    report: &Report,
    errors: &'a [PredictorSummary],
) -> impl Fn(&PredictorInfo) -> Cell + use<'a> {
    let find = |info: &PredictorInfo| {
        errors.iter().find(|error| error.predictor == info.name).map(|error| error.interval)
    };
    let lowest = |standing: Standing| {
        let equals = report.predictors.iter().filter(|info| Standing::of(info) == standing);
        let means: Vec<f64> = equals.filter_map(find).map(|interval| interval.mean).collect();
        let lowest = means.iter().copied().reduce(f64::min).filter(|_| means.len() > 1);
        (standing, lowest.unwrap_or(f64::NEG_INFINITY))
    };
    let lowest = [Standing::Model, Standing::Untold, Standing::Told].map(lowest);
    move |info| {
        let Some(interval) = find(info) else { return Cell::Missing };
        let best = lowest.iter().find(|(standing, _)| *standing == Standing::of(info));
        match best {
            Some((_, lowest)) if interval.mean <= *lowest => Cell::Best(interval, Unit::Degrees),
            _ => Cell::Interval(interval, Unit::Degrees),
        }
    }
}

/// A predictor in a group of scenarios.
struct Scored<'a> {
    predictor: &'a PredictorInfo,
    group: &'a GroupSummary,
    scores: Option<&'a PredictorScores>,
    rollouts: Option<&'a RolloutSummary>,
}

impl<'a> Scored<'a> {
    fn horizon_errors(&self) -> &'a [HorizonError] {
        self.scores.map_or(&[], |scores| &scores.horizon_errors)
    }
}

/// Every predictor in every group of scenarios.
fn scored(report: &Report) -> impl Iterator<Item = Scored<'_>> {
    let groups = report.groups.iter();
    let rows = groups.flat_map(|group| report.predictors.iter().map(move |info| (group, info)));
    rows.map(|(group, predictor)| Scored {
        predictor,
        group,
        scores: group.scores.iter().find(|scores| scores.predictor == predictor.name),
        rollouts: group.rollouts.iter().find(|rollouts| rollouts.predictor == predictor.name),
    })
}

/// How predictions begin, how they jump, and how far they go.
pub(crate) fn continuity(report: &Report) -> Table {
    let note = "The error of the first sample, and the change of the error from one sample to the next: \
                within the patches and at the seams of a model that predicts several samples at a \
                time, and at most. Shares of predictions that leave the limits of a joint, and that \
                get more than 180° off.";
    of_topic(report, Topic::Continuity, "From sample to sample", note)
}

fn jitter(report: &Report) -> Table {
    let note = "The part of predictions above the band of the excitation, in degrees.";
    of_topic(report, Topic::Jitter, "Jitter", note)
}

fn torques(report: &Report) -> Table {
    let note = "Predictors with a model of the arm say the torque for the measured motion of the \
                horizon. Its error against the torque that acted is a mean over joints.";
    of_topic(report, Topic::Torque, "Torque for the measured motion", note)
}

/// The measures of predictors with samples: CRPS, energy score, and the shares inside central
/// intervals. Without rows in an evaluation without samples.
pub(crate) fn samples(report: &Report) -> Table {
    of_topic(report, Topic::Samples, "Samples as a distribution", "")
}

/// The measures of a topic for each group and predictor. There are no rows where nothing was
/// measured, as in older reports.
fn of_topic(report: &Report, topic: Topic, title: &str, note: &str) -> Table {
    let mut table = TableOf::new(scored(report))
        .text("predictor", |row| label(row.predictor))
        .text("scenarios", |row| row.group.name.as_str())
        .measures(PredictorScores::measures().filter(|score| score.topic == topic), |row| {
            row.scores
        })
        .measures(RolloutSummary::measures().filter(|share| share.topic == topic), |row| {
            row.rollouts
        });
    if topic == Topic::Samples {
        table = table.text("central intervals", |row| row.scores.and_then(central_intervals));
    }
    let mut table = table.titled(title, note).means();
    table.rows.retain(|row| row[2..].iter().any(|cell| *cell != Cell::Missing));
    table.without_empty_columns()
}

fn central_intervals(scores: &PredictorScores) -> Option<String> {
    let intervals = scores.intervals.iter().map(|interval| {
        let (nominal, coverage) = (100.0 * interval.nominal, 100.0 * interval.coverage.mean);
        let width = degrees(interval.width_deg.mean);
        format!("{nominal:.0} %: {coverage:.0} % inside, {width}° wide")
    });
    let intervals: Vec<String> = intervals.collect();
    (!intervals.is_empty()).then(|| intervals.join("; "))
}

fn paired(report: &Report) -> Table {
    TableOf::new(&report.paired)
        .text("predictor", |pair| pair.predictor.as_str())
        .text("against", |pair| pair.against.as_str())
        .text("scenarios", |pair| pair.group.as_str())
        .number("difference of RMSE, °", |pair| Cell::Difference(pair.difference_deg))
        .text("verdict", |pair| ComparisonOutcome::of(report, pair).word())
        .titled("Paired differences on the same scenarios", "")
}

fn latencies(report: &Report) -> Table {
    let note = report.predictors.iter().find_map(|info| info.latency.as_ref()).map(|latency| {
        let load = latency.load.map_or(String::new(), |load| format!(", load {load} before"));
        format!(
            "One prediction of one robot, {} times each, on {} with {} threads{load}. These numbers are \
             the machine's as much as the predictors': they differ whenever they are measured.",
            latency.repeats, latency.device, latency.threads,
        )
    });
    TableOf::new(report.predictors.iter().filter(|info| info.latency.is_some()))
        .text("predictor", |info| label(info))
        .measures(Latency::measures(), |info| info.latency.as_ref())
        .titled("Latency", note.unwrap_or_default())
}

/// The worst scenario of each predictor, which comes first in the report.
fn worst(report: &Report, view: impl Fn(&WorstCase) -> Option<String>) -> Table {
    let of = |info: &PredictorInfo| report.worst.iter().find(|case| case.predictor == info.name);
    let cell =
        |case: &WorstCase| cell_name(case.family, case.frequency_hz, case.position_noise_rad);
    let seed = |case: &WorstCase| case.seed.map_or("recorded".to_owned(), |seed| seed.to_string());
    let note = "The worst scenario of each predictor; report.json has the ten worst. With its seed, a \
                trajectory is the same wherever it is simulated.";
    TableOf::new(report.predictors.iter().filter_map(of))
        .text("predictor", |case| case.predictor.as_str())
        .text("cell", |case| cell(case))
        .number("trajectory", |case| case.trajectory.to_string())
        .number("seed", |case| seed(case))
        .number("RMSE, °", |case| Cell::Number(case.rmse_deg, Unit::Degrees))
        .linked(|case| view(case))
        .titled("Worst scenarios", note)
}

fn cell_name(family: Option<Family>, frequency_hz: Option<f64>, noise_rad: f64) -> String {
    let name = match (family, frequency_hz) {
        (Some(family), Some(frequency_hz)) => format!("{family} {frequency_hz} Hz"),
        _ => "all scenarios".to_owned(),
    };
    name + &at_noise(noise_rad)
}

/// The name in tables. It says if the predictor has seen the future that it predicts.
pub(crate) fn label(predictor: &PredictorInfo) -> String {
    let name = &predictor.name;
    // Checkpoints carry their normalization in their name.
    if predictor.sees_the_future() && !name.contains("paper-leaky") {
        format!("{name} (leak: starts with the truth)")
    } else {
        name.clone()
    }
}

/// The knowledge that a predictor has before it sees a context. `None` for older reports.
fn prior_knowledge(predictor: &PredictorInfo) -> Option<String> {
    let leak = match predictor.normalization {
        _ if !predictor.sees_the_future() => None,
        Some(Normalization::PaperLeaky) => {
            Some("the horizon: paper-leaky normalization".to_owned())
        }
        _ => Some("the horizon: starts with the truth".to_owned()),
    };
    let file = predictor.file.map(|file| format!("file {}", file.short()));
    let parts: Vec<String> = [predictor.told.clone(), leak, file].into_iter().flatten().collect();
    (!parts.is_empty()).then(|| parts.join("; "))
}

#[cfg(test)]
mod tests {
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
        let cells = report
            .cells
            .iter()
            .map(|cell| CellSummary { position_noise_rad: 1e-3, ..cell.clone() });
        let noisy: Vec<CellSummary> = cells.collect();
        report.cells.extend(noisy);
        let heading = &lines(&errors(&report))[0];
        assert!(heading.ends_with("  in distribution at 0.001 rad"), "{heading}");
        let titles: Vec<String> =
            by_frequency(&report).into_iter().map(|table| table.title).collect();
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
                "predictor  scenarios        first sample, °  jump, °  largest, °  left limits  diverged",
                "robomorph  in distribution             0.35     0.19        0.80        1.5 %     0.0 %",
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
        for part in
            ["Samples as a distribution", "CRPS, °", "0.50", "90 %: 87 % inside, 2.50° wide"]
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
}
