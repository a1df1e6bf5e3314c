//! Every number of the study as rows, each with the job it comes from.

use wire::{Interval, Latency, PredictorInfo, PredictorScores};

use super::super::results::{Evaluation, Set, Study};

/// Rows under names.
#[derive(Debug)]
pub struct Table {
    pub name: &'static str,
    pub columns: Vec<&'static str>,
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// `columns` are words.
    fn new(name: &'static str, columns: &'static str) -> Self {
        Self { name, columns: columns.split_whitespace().collect(), rows: Vec::new() }
    }

    pub fn to_csv(&self) -> anyhow::Result<Vec<u8>> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(&self.columns)?;
        for row in &self.rows {
            writer.write_record(row)?;
        }
        Ok(writer.into_inner()?)
    }
}

pub fn all(study: &Study) -> Vec<Table> {
    vec![
        rmse(study),
        by_frequency(study),
        paired(study),
        samples(study),
        warm_start(study),
        latency(study),
        trainings(study),
    ]
}

fn rmse(study: &Study) -> Table {
    let mut table =
        Table::new("rmse", "training_set group scenarios predictor rmse_deg low high job digest");
    for set in &study.sets {
        for group in &set.sweep.report.groups {
            for error in &group.rmse_deg {
                let mut row =
                    vec![set.name.clone(), group.name.clone(), group.scenarios.to_string()];
                row.push(name(set, &set.sweep, &error.predictor));
                row.extend(interval(error.interval));
                row.extend(source(&set.sweep));
                table.rows.push(row);
            }
        }
    }
    table
}

fn by_frequency(study: &Study) -> Table {
    let mut table = Table::new(
        "rmse-by-frequency",
        "training_set family frequency_hz in_distribution scenarios predictor rmse_deg low \
         high job digest",
    );
    for set in &study.sets {
        for cell in &set.sweep.report.cells {
            for error in &cell.rmse_deg {
                let mut row = vec![
                    set.name.clone(),
                    text(cell.family),
                    text(cell.frequency_hz),
                    cell.in_distribution.to_string(),
                    cell.scenarios.to_string(),
                    name(set, &set.sweep, &error.predictor),
                ];
                row.extend(interval(error.interval));
                row.extend(source(&set.sweep));
                table.rows.push(row);
            }
        }
    }
    table
}

fn paired(study: &Study) -> Table {
    let mut table = Table::new(
        "paired-differences",
        "training_set group predictor against difference_deg low high job digest",
    );
    for set in &study.sets {
        for paired in &set.sweep.report.paired {
            let mut row = vec![
                set.name.clone(),
                paired.group.clone(),
                name(set, &set.sweep, &paired.predictor),
                name(set, &set.sweep, &paired.against),
            ];
            row.extend(interval(paired.difference_deg));
            row.extend(source(&set.sweep));
            table.rows.push(row);
        }
    }
    table
}

/// Several predictions of each scenario, as distributions.
fn samples(study: &Study) -> Table {
    let mut table = Table::new(
        "samples",
        "training_set group predictor samples rmse_of_mean_deg crps_deg energy_score_deg \
         coverage_50 width_50_deg coverage_90 width_90_deg job digest",
    );
    for set in &study.sets {
        for group in &set.samples.report.groups {
            for scores in group.scores.iter().filter(|scores| scores.crps_deg.is_some()) {
                let mut row = vec![
                    set.name.clone(),
                    group.name.clone(),
                    name(set, &set.samples, &scores.predictor),
                    set.samples.report.samples.to_string(),
                    mean(scores.mean_rmse_deg),
                    mean(scores.crps_deg),
                    mean(scores.energy_score_deg),
                ];
                for nominal in [0.5, 0.9] {
                    row.extend(coverage(scores, nominal));
                }
                row.extend(source(&set.samples));
                table.rows.push(row);
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
    let mut table =
        Table::new("warm-start", "group predictor start steps rmse_deg low high job digest");
    let Some(set) = study.warm_start_set() else { return table };
    let report = &study.warm_start.report;
    for group in &report.groups {
        for error in &group.rmse_deg {
            let Some(info) = report.predictors.iter().find(|info| info.name == error.predictor)
            else {
                continue;
            };
            let mut row = vec![group.name.clone(), set.name_of(info).to_owned()];
            row.extend(how(info));
            row.extend(interval(error.interval));
            row.extend(source(&study.warm_start));
            table.rows.push(row);
        }
    }
    table
}

fn latency(study: &Study) -> Table {
    let mut table = Table::new(
        "latency",
        "predictor start steps median_ms p99_ms repeats threads device load job digest",
    );
    let Some(set) = study.warm_start_set() else { return table };
    for info in &study.warm_start.report.predictors {
        let Some(Latency { median_ms, p99_ms, threads, repeats, device, load }) = &info.latency
        else {
            continue;
        };
        let mut row = vec![set.name_of(info).to_owned()];
        row.extend(how(info));
        row.extend([
            median_ms.to_string(),
            p99_ms.to_string(),
            repeats.to_string(),
            threads.to_string(),
        ]);
        row.extend([device.clone(), text(*load)]);
        row.extend(source(&study.warm_start));
        table.rows.push(row);
    }
    table
}

fn trainings(study: &Study) -> Table {
    let mut table = Table::new(
        "trainings",
        "training_set model steps seconds reused validation_rmse_deg checkpoint sha256 job \
         digest",
    );
    for set in &study.sets {
        for training in &set.trainings {
            let record = &training.record;
            table.rows.push(vec![
                set.name.clone(),
                training.model.clone(),
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
    }
    table
}

/// What a predictor is called in the study.
fn name(set: &Set, evaluation: &Evaluation, predictor: &str) -> String {
    let info = evaluation.report.predictors.iter().find(|info| info.name == predictor);
    info.map_or(predictor, |info| set.name_of(info)).to_owned()
}

/// Start and number of passes.
fn how(info: &PredictorInfo) -> [String; 2] {
    match &info.sampling {
        Some(sampling) => [sampling.start.to_string(), sampling.steps.to_string()],
        None => [String::new(), String::new()],
    }
}

fn source(evaluation: &Evaluation) -> [String; 2] {
    [evaluation.record.job.to_string(), evaluation.record.digest.to_string()]
}

fn interval(Interval { mean, low, high }: Interval) -> [String; 3] {
    [mean, low, high].map(|value| value.to_string())
}

fn mean(interval: Option<Interval>) -> String {
    text(interval.map(|interval| interval.mean))
}

/// Nothing where nothing is known.
fn text(value: Option<impl ToString>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}
