//! Tables with every number of the study. Each row names its job.

use spec::StudyQuestion;
use wire::{Interval, PredictorScores, ShiftSummary};

use crate::Table;

use super::super::results::{Evaluation, Study};
use super::super::tables::{how, interval, latency, source, table, text, trainings};

pub fn all(study: &Study) -> Vec<Table> {
    vec![
        shifts(study),
        seeds(study),
        joints(study),
        differences(study),
        cells(study),
        samples(study),
        warm_start(study),
        latency(study),
        trainings(study),
    ]
}

/// Adds rows for every shift of every evaluation, after the identifying columns.
fn of_shifts(
    study: &Study,
    table: &mut Table,
    rows: impl Fn(&Evaluation, &ShiftSummary) -> Vec<Vec<String>>,
) {
    for evaluation in &study.evaluations {
        for shift in &evaluation.report.shifts {
            let about = [
                study.set_name(evaluation.plan.set),
                evaluation.record.name.clone(),
                shift.shift.to_string(),
                text(shift.family),
            ];
            for row in rows(evaluation, shift) {
                let mut whole = about.to_vec();
                whole.extend(row);
                whole.extend(source(evaluation));
                table.push(whole);
            }
        }
    }
}

fn shifts(study: &Study) -> Table {
    let mut table = table(
        "shifts",
        "training_set evaluation shift family scenarios scored predictor trainings rmse_deg low \
         high skill skill_low skill_high mean_rmse_deg worst_deg diverged job digest",
    );
    of_shifts(study, &mut table, |evaluation, shift| {
        let rows = shift.models.iter().map(|scores| {
            let mut row = vec![shift.scenarios.to_string(), shift.scored.to_string()];
            row.push(name(study, evaluation, &scores.predictors));
            row.push(scores.predictors.len().to_string());
            row.extend(interval_or_nothing(scores.rmse_deg));
            row.extend(interval_or_nothing(scores.skill));
            row.extend([mean(scores.mean_rmse_deg), text(scores.worst_deg)]);
            row.push(scores.diverged.to_string());
            row
        });
        rows.collect()
    });
    table
}

/// A table of each training's error.
fn seeds(study: &Study) -> Table {
    let mut table = table(
        "seeds",
        "training_set evaluation shift family predictor training rmse_deg job digest",
    );
    of_shifts(study, &mut table, |evaluation, shift| {
        let each = shift.models.iter().flat_map(|scores| {
            let name = name(study, evaluation, &scores.predictors);
            let of_seeds = scores.predictors.iter().zip(&scores.seed_rmse_deg);
            of_seeds
                .map(move |(training, rmse)| vec![name.clone(), training.clone(), rmse.to_string()])
        });
        each.collect()
    });
    table
}

fn joints(study: &Study) -> Table {
    let mut table =
        table("joints", "training_set evaluation shift family predictor joint rmse_deg job digest");
    of_shifts(study, &mut table, |evaluation, shift| {
        let each = shift.models.iter().flat_map(|scores| {
            let name = name(study, evaluation, &scores.predictors);
            (1..).zip(&scores.joint_rmse_deg).map(move |(joint, rmse): (u32, _)| {
                vec![name.clone(), joint.to_string(), rmse.to_string()]
            })
        });
        each.collect()
    });
    table
}

fn differences(study: &Study) -> Table {
    let mut table = table(
        "differences",
        "training_set evaluation shift family predictor against difference_deg low high job digest",
    );
    of_shifts(study, &mut table, |evaluation, shift| {
        let each = shift.differences.iter().map(|difference| {
            let mut row = vec![
                study.called(evaluation, &difference.predictor).to_owned(),
                study.called(evaluation, &difference.against).to_owned(),
            ];
            row.extend(interval(difference.difference_deg));
            row
        });
        each.collect()
    });
    table
}

/// A table of every predictor in every cell, over all scenarios.
fn cells(study: &Study) -> Table {
    let mut table = table(
        "cells",
        "training_set evaluation family frequency_hz shift scenarios within_torque_limits predictor \
         training rmse_deg low high job digest",
    );
    for evaluation in &study.evaluations {
        for cell in &evaluation.report.cells {
            for error in &cell.rmse_deg {
                let mut row = vec![
                    study.set_name(evaluation.plan.set),
                    evaluation.record.name.clone(),
                    text(cell.family),
                    text(cell.frequency_hz),
                    text(cell.shift),
                    cell.scenarios.to_string(),
                    text(cell.within_torque_limits),
                    study.called(evaluation, &error.predictor).to_owned(),
                    error.predictor.clone(),
                ];
                row.extend(interval(error.interval));
                row.extend(source(evaluation));
                table.push(row);
            }
        }
    }
    table
}

/// A table of several predictions per scenario, scored as distributions, training by training.
fn samples(study: &Study) -> Table {
    let mut table = table(
        "samples",
        "training_set group predictor training samples rmse_deg rmse_of_mean_deg crps_deg \
         energy_score_deg coverage_50 width_50_deg coverage_90 width_90_deg job digest",
    );
    for evaluation in study
        .evaluations
        .iter()
        .filter(|evaluation| evaluation.plan.question == StudyQuestion::Samples)
    {
        for group in &evaluation.report.groups {
            for scores in group.scores.iter().filter(|scores| scores.crps_deg.is_some()) {
                let error = group.rmse_deg.iter().find(|rmse| rmse.predictor == scores.predictor);
                let mut row = vec![
                    study.set_name(evaluation.plan.set),
                    group.name.clone(),
                    study.called(evaluation, &scores.predictor).to_owned(),
                    scores.predictor.clone(),
                    evaluation.report.samples.to_string(),
                    mean(error.map(|error| error.interval)),
                    mean(scores.mean_rmse_deg),
                    mean(scores.crps_deg),
                    mean(scores.energy_score_deg),
                ];
                for nominal in [0.5, 0.9] {
                    row.extend(coverage(scores, nominal));
                }
                row.extend(source(evaluation));
                table.push(row);
            }
        }
    }
    table
}

fn coverage(scores: &PredictorScores, nominal: f64) -> [String; 2] {
    let found = scores.intervals.iter().find(|found| (found.nominal - nominal).abs() < 1e-9);
    [mean(found.map(|found| found.coverage)), mean(found.map(|found| found.width_deg))]
}

fn warm_start(study: &Study) -> Table {
    let mut table = table("warm-start", "group predictor start steps rmse_deg low high job digest");
    let Some(evaluation) = study.warm_start() else { return table };
    let report = &evaluation.report;
    for group in &report.groups {
        for error in &group.rmse_deg {
            let Some(info) = report.predictors.iter().find(|info| info.name == error.predictor)
            else {
                continue;
            };
            let mut row = vec![group.name.clone(), study.name_of(info).to_owned()];
            row.extend(how(info));
            row.extend(interval(error.interval));
            row.extend(source(evaluation));
            table.push(row);
        }
    }
    table
}

/// The name of the model, for its replications, or of the baseline.
fn name(study: &Study, evaluation: &Evaluation, predictors: &[String]) -> String {
    predictors.first().map_or_else(String::new, |first| study.called(evaluation, first).to_owned())
}

fn interval_or_nothing(found: Option<Interval>) -> [String; 3] {
    found.map_or_else(Default::default, interval)
}

fn mean(interval: Option<Interval>) -> String {
    text(interval.map(|interval| interval.mean))
}
