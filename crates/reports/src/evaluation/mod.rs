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
                time, as root mean squares. The largest change of a scenario's joint is averaged over \
                scenarios and joints; it is less than the jump where few scenarios have large changes. \
                Shares of predictions that leave the limits of a joint, and that get more than 180° off.";
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
mod tests;
