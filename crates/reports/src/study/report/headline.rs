//! Tables of errors and skill of every model and baseline, by shift.

use std::fmt::Write;

use spec::StudyQuestion;
use wire::{Interval, Latency, ShiftScores};

use crate::numbers::degrees;

use super::super::results::Study;
use super::columns::COLUMNS;
use super::text::{markdown, none, with_interval};

/// Tables of errors, one per training set.
pub fn errors(study: &Study) -> String {
    let of_set =
        |set: usize| table(study, set, |scores| scores.rmse_deg.map_or_else(none, with_interval));
    each_set(study, of_set)
}

/// Tables of skill: 1 - RMSE / RMSE of the damped integrator.
pub fn skill(study: &Study) -> String {
    let share = |Interval { mean, low, high }: Interval| format!("{mean:.2} [{low:.2}, {high:.2}]");
    let of_set = |set: usize| table(study, set, |scores| scores.skill.map_or_else(none, share));
    each_set(study, of_set)
}

fn each_set(study: &Study, table: impl Fn(usize) -> String) -> String {
    let mut text = String::new();
    for set in 1..=study.sets() {
        let _ = writeln!(text, "Trained on D{set}:\n\n{}", table(set));
    }
    text
}

fn table(study: &Study, set: usize, cell: impl Fn(&ShiftScores) -> String) -> String {
    let mut columns = vec!["", "trainings"];
    columns.extend(COLUMNS.iter().map(|column| column.title));
    let mut rejected = vec!["*rejected*".to_owned(), String::new()];
    rejected.extend(COLUMNS.iter().map(|column| {
        column.of(study, set).map_or_else(none, |(_, shift)| {
            let beyond = (shift.scenarios - shift.scored) as f64;
            format!("*{:.0} % of {}*", 100.0 * beyond / shift.scenarios as f64, shift.scenarios)
        })
    }));
    let mut rows = vec![rejected];
    let names = study.evaluation(set, StudyQuestion::Sweep).map(|sweep| study.names(sweep));
    for name in names.unwrap_or_default() {
        let trainings = study.trainings.iter().filter(|training| {
            training.plan.set == set
                && training.plan.model == name
                && training.plan.length.is_none()
        });
        let count = trainings.count();
        let mut row = vec![name.to_owned(), if count > 0 { count.to_string() } else { none() }];
        row.extend(
            COLUMNS.iter().map(|column| column.scores(study, set, name).map_or_else(none, &cell)),
        );
        rows.push(row);
    }
    markdown(&columns, &rows)
}

/// Tables of the worst scenario, the diverged share and the latency beside the error, over all
/// columns of a set.
pub fn worst(study: &Study) -> String {
    let of_set = |set: usize| {
        let columns = ["", "worst RMSE", "diverged", "median latency", "p99"];
        let Some(sweep) = study.evaluation(set, StudyQuestion::Sweep) else { return String::new() };
        let row = |name: &str| {
            let scores: Vec<&ShiftScores> =
                COLUMNS.iter().filter_map(|column| column.scores(study, set, name)).collect();
            let worst = scores.iter().filter_map(|scores| scores.worst_deg).reduce(f64::max);
            let diverged = scores.iter().map(|scores| scores.diverged).reduce(f64::max);
            let mut predictors = sweep.report.predictors.iter();
            let timed = predictors.find(|info| study.name_of(info) == name);
            let latency = timed.and_then(|info| info.latency.as_ref());
            let ms = |of: fn(&Latency) -> f64| {
                latency.map_or_else(none, |latency| format!("{:.1} ms", of(latency)))
            };
            vec![
                name.to_owned(),
                worst.map_or_else(none, degrees),
                diverged.map_or_else(none, |share| format!("{:.1} %", 100.0 * share)),
                ms(|latency| latency.median_ms),
                ms(|latency| latency.p99_ms),
            ]
        };
        let rows: Vec<Vec<String>> = study.names(sweep).into_iter().map(row).collect();
        markdown(&columns, &rows)
    };
    each_set(study, of_set)
}

/// Tables of each joint's RMSE within the training distribution.
pub fn joints(study: &Study) -> String {
    let set = 1;
    let within = &COLUMNS[0];
    let Some((evaluation, _)) = within.of(study, set) else { return String::new() };
    let mut rows = Vec::new();
    let mut joints = 0;
    for name in study.names(evaluation) {
        let Some(scores) = within.scores(study, set, name) else { continue };
        joints = joints.max(scores.joint_rmse_deg.len());
        let of_joints = scores.joint_rmse_deg.iter().map(|&rmse| degrees(rmse));
        rows.push([name.to_owned()].into_iter().chain(of_joints).collect());
    }
    let titles: Vec<String> = (1..=joints).map(|joint| format!("joint {joint}")).collect();
    let columns: Vec<&str> = [""].into_iter().chain(titles.iter().map(String::as_str)).collect();
    markdown(&columns, &rows)
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
        let titles: Vec<String> = of_lengths
            .iter()
            .map(|((context, horizon), _)| format!("{context} → {horizon}"))
            .collect();
        let names: Vec<&str> = match of_lengths.first() {
            Some((_, evaluation)) => study.names(evaluation),
            None => continue,
        };
        let rows = names.into_iter().map(|name| {
            let of_each = of_lengths.iter().map(|(_, evaluation)| {
                let found = column.in_evaluation(evaluation);
                let scores = found.and_then(|shift| study.scores(evaluation, shift, name));
                scores.and_then(|scores| scores.rmse_deg).map_or_else(none, with_interval)
            });
            [name.to_owned()].into_iter().chain(of_each).collect()
        });
        let rows: Vec<Vec<String>> = rows.collect();
        let columns: Vec<&str> =
            [""].into_iter().chain(titles.iter().map(String::as_str)).collect();
        let _ = writeln!(text, "RMSE {what}, context → horizon in samples:\n");
        let _ = writeln!(text, "{}", markdown(&columns, &rows));
    }
    text
}
