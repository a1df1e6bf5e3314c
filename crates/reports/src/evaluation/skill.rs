//! The skill of predictors, on a scale from the last position held to the robot itself.

use wire::{GroupSummary, ORACLE, Report, Unit};

use super::{Scored, label, scored};
use crate::numbers::value;
use crate::{Cell, Table, TableOf};

/// The skill of every predictor relative to what can be known: 0 where it is as good as holding the
/// last position, and 1 where it is as good as the robot itself. Without rows unless both are there.
pub(crate) fn skill(report: &Report) -> Table {
    let known = |name: &str, group: &GroupSummary| {
        let info = report.predictors.iter().find(|info| info.name == name)?;
        (name == HELD || info.is_oracle()).then(|| Errors::of(group, name))
    };
    let bounded = |row: &Scored<'_>| known(ORACLE, row.group).zip(known(HELD, row.group)).is_some();
    let competes = |row: &Scored<'_>| !row.predictor.is_oracle() && row.predictor.name != HELD;
    let rows: Vec<Scored<'_>> =
        scored(report).filter(|row| bounded(row) && competes(row)).collect();
    let measured = rows.iter().map(Scored::horizon_errors).find(|errors| !errors.is_empty());
    let first = measured.unwrap_or_default();
    let seconds: Vec<f64> = first.iter().map(|error| error.seconds).collect();
    let cell = |row: &Scored<'_>, error: &dyn Fn(&Errors) -> Option<f64>| {
        let [oracle, held] = [known(ORACLE, row.group)?, known(HELD, row.group)?];
        let own = Errors::of(row.group, &row.predictor.name);
        let [least, most, own] = [error(&oracle)?, error(&held)?, error(&own)?];
        (most > least).then(|| Cell::Number((most - own) / (most - least), Unit::Ratio))
    };
    let predictors = TableOf::new(rows)
        .text("predictor", |row| label(row.predictor))
        .text("scenarios", |row| row.group.name.as_str());
    let with_seconds = seconds.iter().enumerate().fold(predictors, |table, (k, &seconds)| {
        table.number(&format!("{} s", value(seconds)), |row| {
            cell(row, &|errors: &Errors| errors.horizons.get(k).copied())
        })
    });
    with_seconds
        .number("all", |row| cell(row, &|errors: &Errors| errors.whole))
        .titled("Skill relative to what can be known: 0 holds, 1 is the robot itself", "")
}

/// The baseline that has no skill.
const HELD: &str = "hold-last";

/// Mean errors of a predictor in a group, degrees.
struct Errors {
    whole: Option<f64>,
    horizons: Vec<f64>,
}

impl Errors {
    fn of(group: &GroupSummary, predictor: &str) -> Self {
        let whole = group.rmse_deg.iter().find(|error| error.predictor == predictor);
        let scores = group.scores.iter().find(|scores| scores.predictor == predictor);
        let horizons = scores.map_or(&[][..], |scores| &scores.horizon_errors);
        Self {
            whole: whole.map(|error| error.interval.mean),
            horizons: horizons.iter().map(|error| error.rmse_deg.mean).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use wire::{HorizonError, Interval, PredictorScores};

    use super::super::errors;
    use super::*;
    use crate::example;

    #[test]
    fn skill_lies_between_the_last_position_and_the_robot_itself() {
        let mut report = example();
        assert!(skill(&report).rows.is_empty());
        report.predictors[1].name = ORACLE.to_owned();
        for group in &mut report.groups {
            group.rmse_deg[1].predictor = ORACLE.to_owned();
        }
        let error = |mean| HorizonError {
            seconds: 0.1,
            rmse_deg: Interval { mean, low: mean, high: mean },
        };
        let scores = |predictor: &str, mean| PredictorScores {
            predictor: predictor.to_owned(),
            horizon_errors: vec![error(mean)],
            ..PredictorScores::default()
        };
        for group in &mut report.groups {
            group.scores = vec![scores(HELD, 1.0), scores(ORACLE, 0.5), scores("robomorph", 0.6)];
        }
        let table = skill(&report).render();
        let words: Vec<Vec<&str>> =
            table.lines().map(|line| line.split_whitespace().collect()).collect();
        assert_eq!(words[0], ["predictor", "scenarios", "0.1", "s", "all"]);
        assert_eq!(words[2], ["robomorph", "out", "of", "distribution", "0.80", "0.92"]);
        assert_eq!(words.len(), 3);
        let has_best = |row: &Vec<Cell>| row.iter().any(Cell::is_best);
        let best: Vec<bool> = errors(&report).rows.iter().map(has_best).collect();
        assert_eq!(best, [false; 3], "the robot itself is never the best");
    }
}
