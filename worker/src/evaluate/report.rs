//! The last task of an evaluation: it puts the cells together.

use std::collections::HashMap;

use arrow_array::RecordBatch;
use evaluation::{CellResult, ErrorHorizon, Setting, summarize};
use jobs::EvaluateTask;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use spec::{DataSpec, EvaluateSpec};
use store::{Metric, RunId, Task};
use wire::{DataNoise, EvaluationResult, GroupSummary, Headline, PredictorSummary, Report};

use super::cell::{CellRecord, TableAt};
use super::checkpoints::LoadedCheckpoint;
use super::examples::ExampleInputs;
use super::latency::LatencyRecord;
use super::predictions::PredictionFile;
use super::predictors::Predictors;
use super::renames::PresentNames;
use super::{examples, figures, rows};
use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::trajectories::TrajectorySource;

/// Puts the cells together: `report.json`, `scenarios.parquet`, figures with their tables, and a few predictions.
pub(super) fn report(attempt: &Attempt, spec: &EvaluateSpec) -> Result<(), TaskError> {
    let data = TrajectorySource::open(attempt, &spec.data, spec.given)?;
    let checkpoints = LoadedCheckpoint::load_all(attempt, &spec.checkpoints)?;
    let tasks = attempt.wait(attempt.store.tasks(attempt.task.job))?;
    let files = PredictionFile::open_all(attempt, spec)?;
    let predictors = Predictors::new(spec, data.spec(), &files, &checkpoints)?;
    let Cells { cells, renamed } = cells(attempt, &tasks, &PresentNames::of(&predictors))?;
    tracing::info!(cells = cells.len(), "puts the cells together");
    attempt.check_stop()?;

    let mut predictors = predictors.infos();
    let mut latencies = results(&tasks, |task| task == EvaluateTask::Latency);
    let latencies: LatencyRecord = latencies.next().transpose()?.unwrap_or_default();
    for (name, latency) in latencies.latencies {
        let name = renamed.get(&name).unwrap_or(&name);
        if let Some(info) = predictors.iter_mut().find(|info| info.name == *name) {
            info.latency = Some(latency);
        }
    }
    let setting = Setting {
        context: spec.context,
        horizon: spec.horizon(data.spec().samples()),
        rate_hz: data.spec().rate_hz(),
        samples: spec.samples,
        given: spec.given,
        data_noise: data_noise(data.spec()),
        seed: data.spec().simulation().map(|spec| spec.seed),
        bootstrap: spec.bootstrap,
        excitation: data.spec().simulation().map(|spec| spec.excitation.clone()),
        predictors,
        trained_on: checkpoints.iter().map(|checkpoint| checkpoint.trained_on.clone()).collect(),
    };
    let report = attempt.interruptible(|| summarize(setting, &cells))??;
    attempt.check_stop()?;

    attempt.put("report.json", "application/json", serde_json::to_vec_pretty(&report)?)?;
    for (name, figure) in figures::all(&report) {
        let svg = figure.to_svg(::figures::Size::PAGE)?;
        attempt.put(&format!("{name}.svg"), "image/svg+xml", svg.into_bytes())?;
        attempt.put(&format!("{name}.csv"), "text/csv", figure.to_csv().into_bytes())?;
    }
    let (predictors, checkpoints) = (&report.predictors, &checkpoints);
    let asked = ExampleInputs { spec, data: &data, files: &files, checkpoints, predictors };
    examples::put(attempt, &asked, &cells)?;
    let joints = data.spec().joints();
    let horizon = spec.horizon(data.spec().samples()) as usize;
    let horizons = ErrorHorizon::all(&spec.horizons_s, data.spec().rate_hz(), horizon);
    let horizons_s: Vec<f64> = horizons.iter().map(|horizon| horizon.seconds).collect();
    let seed = data.spec().simulation().map(|spec| spec.seed);
    let tables = cells.iter().map(|cell| rows::record_batch(cell, &horizons_s, seed));
    let tables = tables.collect::<Result<_, _>>()?;
    let footer = rows::footer(&attempt.task.spec, joints, &horizons_s);
    let written = attempt.store.put_table(attempt.fence(), "scenarios.parquet", tables, &footer);
    attempt.wait(written)?;
    attempt.wait(attempt.store.record_metrics(attempt.fence(), &metrics(&report)))?;
    attempt.complete(&EvaluationResult { headline: Headline::of(&report) })
}

/// The mean RMSE of each predictor in each group, degrees, as metrics such as
/// `in distribution/lagrangian/rmse_deg`. Characters that keys of MLflow may not have become `_`.
fn metrics(report: &Report) -> Vec<Metric> {
    let allowed = |c: char| if c.is_alphanumeric() || "_-. :".contains(c) { c } else { '_' };
    let part = |name: &str| -> String { name.chars().map(allowed).collect() };
    let of_group = |group: &GroupSummary| {
        let group_name = part(&group.name);
        let metric = |rmse: &PredictorSummary| Metric {
            key: format!("{group_name}/{}/rmse_deg", part(&rmse.predictor)),
            step: 0,
            value: rmse.interval.mean,
        };
        let finite = group.rmse_deg.iter().filter(|rmse| rmse.interval.mean.is_finite());
        finite.map(metric).collect::<Vec<_>>()
    };
    report.groups.iter().flat_map(of_group).collect()
}

fn data_noise(data: &DataSpec) -> Option<DataNoise> {
    let noise = DataNoise {
        position_rad: data.position_deviation_rad(),
        torque_nm: data.torque_noise_nm(),
    };
    (noise.position_rad > 0.0 || noise.torque_nm > 0.0).then_some(noise)
}

/// The results of the cells, in order.
#[derive(Default)]
struct Cells {
    cells: Vec<CellResult>,
    /// The present names of predictors, by those that some cell has for them.
    renamed: HashMap<String, String>,
}

fn cells(attempt: &Attempt, tasks: &[Task], names: &PresentNames) -> Result<Cells, TaskError> {
    let mut found = Cells::default();
    for record in results(tasks, |task| matches!(task, EvaluateTask::Cell(_))) {
        let CellRecord { mut result, table } = record?;
        rows::complete(&mut result, &read_table(attempt, &table)?)?;
        found.renamed.extend(names.give_to(&mut result));
        found.cells.push(result);
    }
    Ok(found)
}

fn read_table(attempt: &Attempt, at: &TableAt) -> Result<Vec<RecordBatch>, TaskError> {
    let artifact = attempt.wait(attempt.store.artifact(RunId(at.run), &at.artifact))?;
    Ok(rows::read(&attempt.store.open_table(&artifact.object)?)?)
}

/// The results of the `wanted` tasks.
fn results<T: DeserializeOwned>(
    tasks: &[Task],
    wanted: impl Fn(EvaluateTask) -> bool,
) -> impl Iterator<Item = Result<T, TaskError>> {
    let is_wanted = move |task: &&Task| EvaluateTask::deserialize(&task.payload).is_ok_and(&wanted);
    let results = tasks.iter().filter(is_wanted).filter_map(|task| task.result.as_ref());
    results.map(|result| Ok(T::deserialize(result)?))
}
