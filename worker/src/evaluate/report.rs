use arrow::array::RecordBatch;
use evaluation::{CellResult, Setting, summarize};
use spec::EvaluateSpec;
use store::{NewArtifact, RunId, Task};

use super::cell::{CellRecord, TableAt};
use super::checkpoints::LoadedCheckpoint;
use super::latency::LatencyRecord;
use super::predictors::Predictors;
use super::{CELL, LATENCY, figures, rows};
use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::trajectories::TrajectorySource;

/// Puts the cells together: `report.json`, `scenarios.parquet`, and figures with their tables.
pub(super) fn report(attempt: &Attempt, spec: &EvaluateSpec) -> Result<(), TaskError> {
    let data = TrajectorySource::open(attempt, &spec.data)?;
    let checkpoints = LoadedCheckpoint::load_all(attempt, &spec.checkpoints)?;
    let tasks = attempt.wait(attempt.store.tasks(attempt.task.job))?;
    let (cells, tables) = cells(attempt, &tasks)?;
    attempt.check_stop()?;

    let mut predictors = Predictors::new(spec, data.spec(), &checkpoints).infos();
    let latencies = result::<LatencyRecord>(&tasks, LATENCY).next().transpose()?;
    for (name, latency) in latencies.unwrap_or_default().latencies {
        if let Some(info) = predictors.iter_mut().find(|info| info.name == name) {
            info.latency = Some(latency);
        }
    }
    let setting = Setting {
        context: spec.context,
        horizon: spec.horizon(data.spec().samples()),
        rate_hz: data.spec().rate_hz(),
        samples: spec.samples,
        seed: data.spec().simulation().map(|spec| spec.seed),
        bootstrap: spec.bootstrap,
        predictors,
        trained_on: checkpoints.iter().map(|checkpoint| checkpoint.trained_on.clone()).collect(),
    };
    let report = summarize(setting, &cells)?;
    attempt.check_stop()?;

    put(attempt, "report.json", "application/json", serde_json::to_vec_pretty(&report)?)?;
    for (name, figure) in figures::all(&report) {
        let svg = figure.to_svg(::figures::Size::PAGE)?;
        put(attempt, &format!("{name}.svg"), "image/svg+xml", svg.into_bytes())?;
        put(attempt, &format!("{name}.csv"), "text/csv", figure.to_csv().into_bytes())?;
    }
    let footer = rows::footer(&attempt.task.spec);
    let written = attempt.store.put_table(attempt.fence(), "scenarios.parquet", tables, &footer);
    attempt.wait(written)?;
    attempt.wait(attempt.store.complete(attempt.fence(), None))?;
    Ok(())
}

/// The results of the cells in order, and the rows of their tables.
fn cells(
    attempt: &Attempt,
    tasks: &[Task],
) -> Result<(Vec<CellResult>, Vec<RecordBatch>), TaskError> {
    let mut cells = Vec::new();
    let mut tables = Vec::new();
    for record in result::<CellRecord>(tasks, CELL) {
        let CellRecord { mut result, table } = record?;
        if let Some(at) = table {
            let rows = read_table(attempt, &at)?;
            rows::complete(&mut result, &rows)?;
            tables.extend(rows);
        } else if let Some(rows) = earlier_rows(&result)? {
            tables.push(rows);
        }
        cells.push(result);
    }
    Ok((cells, tables))
}

/// Of results that hold everything.
fn earlier_rows(result: &CellResult) -> Result<Option<RecordBatch>, TaskError> {
    let is_whole = result.predictors.iter().all(|errors| !errors.scenarios.is_empty());
    Ok(if is_whole { Some(rows::record_batch(result, None)?) } else { None })
}

fn read_table(attempt: &Attempt, at: &TableAt) -> Result<Vec<RecordBatch>, TaskError> {
    let artifact = attempt.wait(attempt.store.artifact(RunId(at.run), &at.artifact))?;
    Ok(rows::read(&attempt.store.open_table(&artifact.object)?)?)
}

/// Results of the tasks with `key` in their payload.
fn result<'a, T: serde::de::DeserializeOwned>(
    tasks: &'a [Task],
    key: &'a str,
) -> impl Iterator<Item = Result<T, TaskError>> + 'a {
    let of_kind = tasks.iter().filter(move |task| task.payload.get(key).is_some());
    let results = of_kind.filter_map(|task| task.result.clone());
    results.map(|result| Ok(serde_json::from_value(result)?))
}

fn put(attempt: &Attempt, name: &str, media_type: &str, bytes: Vec<u8>) -> Result<(), TaskError> {
    let artifact = NewArtifact { name, media_type, bytes: bytes.into() };
    attempt.wait(attempt.store.put_artifact(attempt.fence(), artifact))?;
    Ok(())
}
