//! Tables that every edition has, and the parts of their rows.

use wire::{Interval, Latency, PredictorInfo};

use super::results::{Evaluation, Study};
use crate::{Align, Table};

/// A table that is named as its file. `columns` has the names, separated by spaces.
pub(super) fn table(name: &str, columns: &str) -> Table {
    let columns = columns.split_whitespace().map(|column| (column, Align::Left));
    Table::new(columns).titled(name, "")
}

/// A table of every measured latency.
pub(super) fn latency(study: &Study) -> Table {
    let mut table = table(
        "latency",
        "training_set predictor training start steps median_ms p99_ms repeats threads device load job \
         digest",
    );
    for evaluation in &study.evaluations {
        for info in &evaluation.report.predictors {
            let Some(Latency { median_ms, p99_ms, threads, repeats, device, load }) = &info.latency
            else {
                continue;
            };
            let mut row = vec![
                study.set_name(evaluation.plan.set),
                study.name_of(info).to_owned(),
                info.name.clone(),
            ];
            row.extend(how(info));
            row.extend([
                median_ms.to_string(),
                p99_ms.to_string(),
                repeats.to_string(),
                threads.to_string(),
            ]);
            row.extend([device.clone(), text(*load)]);
            row.extend(source(evaluation));
            table.push(row);
        }
    }
    table
}

/// A table of every training.
pub(super) fn trainings(study: &Study) -> Table {
    let mut table = table(
        "trainings",
        "training_set model seed context horizon steps seconds reused validation_rmse_deg checkpoint \
         sha256 job digest",
    );
    for training in &study.trainings {
        let (record, plan) = (&training.record, &training.plan);
        let (context, horizon) = plan.length.unzip();
        table.push(vec![
            study.set_name(plan.set),
            plan.model.clone(),
            plan.seed.to_string(),
            text(context),
            text(horizon),
            training.steps.to_string(),
            text(record.seconds),
            record.reused.to_string(),
            text(training.validation_rmse_deg),
            training.checkpoint.to_string(),
            training.sha256.clone(),
            record.job.to_string(),
            record.digest.to_string(),
        ]);
    }
    table
}

/// The start and the number of passes.
pub(super) fn how(info: &PredictorInfo) -> [String; 2] {
    match &info.sampling {
        Some(sampling) => [sampling.start.to_string(), sampling.steps.to_string()],
        None => [String::new(), String::new()],
    }
}

/// The job and the digest of an evaluation.
pub(super) fn source(evaluation: &Evaluation) -> [String; 2] {
    [evaluation.record.job.to_string(), evaluation.record.digest.to_string()]
}

/// A mean with the ends of its interval.
pub(super) fn interval(Interval { mean, low, high }: Interval) -> [String; 3] {
    [mean, low, high].map(|value| value.to_string())
}

/// The value as text; empty if there is none.
pub(super) fn text(value: Option<impl ToString>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}
