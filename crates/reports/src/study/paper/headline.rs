//! Tables of errors and skill of every model and baseline, by shift.

use std::fmt::Write;

use spec::StudyQuestion;
use wire::{Latency, ShiftScores, Unit};

use crate::{Cell, TableOf};

use super::super::results::{Study, Training};
use super::columns::{COLUMNS, ShiftColumn};

/// Tables of errors, one per training set.
pub fn errors(study: &Study) -> String {
    each_set(study, |set| {
        table(study, set, |scores| Some(Cell::Interval(scores.rmse_deg?, Unit::Degrees)))
    })
}

/// Tables of skill: 1 - RMSE / RMSE of the damped integrator.
pub fn skill(study: &Study) -> String {
    each_set(study, |set| {
        table(study, set, |scores| Some(Cell::Interval(scores.skill?, Unit::Ratio)))
    })
}

fn each_set(study: &Study, table: impl Fn(usize) -> String) -> String {
    let mut text = String::new();
    for set in 1..=study.sets() {
        let _ = writeln!(text, "Trained on D{set}:\n\n{}", table(set));
    }
    text
}

fn table(study: &Study, set: usize, cell: impl Fn(&ShiftScores) -> Option<Cell>) -> String {
    let rejected = |column: &ShiftColumn| {
        let (_, shift) = column.of(study, set)?;
        let beyond = (shift.scenarios - shift.scored) as f64;
        let percent = 100.0 * beyond / shift.scenarios as f64;
        Some(Cell::from(format!("*{percent:.0} % of {}*", shift.scenarios)))
    };
    let trainings = |name: &str| {
        let is_counted = |training: &&Training| {
            let plan = &training.plan;
            plan.set == set && plan.model == name && plan.length.is_none()
        };
        let count = study.trainings.iter().filter(is_counted).count();
        (count > 0).then(|| count.to_string())
    };
    let names = study.evaluation(set, StudyQuestion::Sweep).map(|sweep| study.names(sweep));
    let names = names.unwrap_or_default().into_iter().map(Some);
    // The first row says how many scenarios are left out.
    let rows = TableOf::new(std::iter::once(None).chain(names))
        .text("", |name| name.unwrap_or("*rejected*"))
        .text("trainings", |name| name.map_or(Some(String::new()), trainings));
    let with_columns = COLUMNS.iter().fold(rows, |table, column| {
        table.text(column.title, |name| match name {
            Some(name) => column.scores(study, set, name).and_then(&cell),
            None => rejected(column),
        })
    });
    with_columns.to_markdown()
}

/// Tables of the worst scenario, the diverged share and the latency beside the error, over all
/// columns of a set.
pub fn worst(study: &Study) -> String {
    let of_set = |set: usize| {
        let Some(sweep) = study.evaluation(set, StudyQuestion::Sweep) else { return String::new() };
        let largest = |name: &str, of: fn(&ShiftScores) -> Option<f64>, unit: Unit| {
            let scores = COLUMNS.iter().filter_map(|column| column.scores(study, set, name));
            Some(Cell::Number(scores.filter_map(of).reduce(f64::max)?, unit))
        };
        let ms = |name: &str, of: fn(&Latency) -> f64| {
            let mut predictors = sweep.report.predictors.iter();
            let timed = predictors.find(|info| study.name_of(info) == name)?;
            Some(format!("{:.1} ms", of(timed.latency.as_ref()?)))
        };
        TableOf::new(study.names(sweep))
            .text("", |name| *name)
            .text("worst RMSE", |name| largest(name, |scores| scores.worst_deg, Unit::Degrees))
            .text("diverged", |name| largest(name, |scores| Some(scores.diverged), Unit::Share))
            .text("median latency", |name| ms(name, |latency| latency.median_ms))
            .text("p99", |name| ms(name, |latency| latency.p99_ms))
            .to_markdown()
    };
    each_set(study, of_set)
}

/// Tables of each joint's RMSE within the training distribution.
pub fn joints(study: &Study) -> String {
    let set = 1;
    let within = &COLUMNS[0];
    let Some((evaluation, _)) = within.of(study, set) else { return String::new() };
    let names = study.names(evaluation).into_iter();
    let rows: Vec<(&str, &ShiftScores)> =
        names.filter_map(|name| Some((name, within.scores(study, set, name)?))).collect();
    let joints = rows.iter().map(|(_, scores)| scores.joint_rmse_deg.len()).max().unwrap_or(0);
    let names = TableOf::new(rows).text("", |(name, _)| *name);
    let with_joints = (0..joints).fold(names, |table, joint| {
        let rmse = |scores: &ShiftScores| {
            Some(Cell::Number(*scores.joint_rmse_deg.get(joint)?, Unit::Degrees))
        };
        table.text(&format!("joint {}", joint + 1), |(_, scores)| rmse(scores))
    });
    with_joints.to_markdown()
}

/// Tables of RMSE by context and by horizon, for models trained on D1.
pub fn lengths(study: &Study) -> String {
    let mut text = String::new();
    for (column, what) in [(0, "within what was trained"), (2, "chirps above the band")] {
        let column = &COLUMNS[column];
        let mut of_lengths: Vec<_> = study
            .evaluations
            .iter()
            .filter_map(|evaluation| match evaluation.plan.question {
                StudyQuestion::Lengths { context, horizon } => {
                    Some(((context, horizon), evaluation))
                }
                _ => None,
            })
            .collect();
        of_lengths.sort_by_key(|((context, horizon), _)| (*horizon, *context));
        let Some((_, first)) = of_lengths.first() else { continue };
        let names = TableOf::new(study.names(first)).text("", |name| *name);
        let table = of_lengths.iter().fold(names, |table, ((context, horizon), evaluation)| {
            let shift = column.in_evaluation(evaluation);
            let rmse = |name: &str| {
                let scores = study.scores(evaluation, shift?, name)?;
                Some(Cell::Interval(scores.rmse_deg?, Unit::Degrees))
            };
            table.text(&format!("{context} → {horizon}"), |name| rmse(name))
        });
        let _ = writeln!(text, "RMSE {what}, context → horizon in samples:\n");
        let _ = writeln!(text, "{}", table.to_markdown());
    }
    text
}
