//! Asks every predictor for the scenarios of one cell, and keeps their errors.

use evaluation::metrics::{band_edge_hz, highest_component_hz, occupied_band_hz};
use evaluation::{CellResult, Scenarios, Scoring, evaluate_cell, measured_jitter_deg};
use serde::{Deserialize, Serialize};
use spec::{DataSpec, EvaluateSpec, JOINTS, ScenarioCell};

use super::checkpoints::LoadedCheckpoint;
use super::predictors::Predictors;
use super::rows;
use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::trajectories::{Series, TrajectorySource};

/// The result of a cell's task: what of it is not in the table.
#[derive(Serialize, Deserialize)]
pub(super) struct CellRecord {
    #[serde(flatten)]
    pub result: CellResult,
    /// Where its table is: in the run of the job that evaluated it, which need not be this one.
    pub table: TableAt,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct TableAt {
    pub run: i64,
    pub artifact: String,
}

pub(super) fn cell(attempt: &Attempt, spec: &EvaluateSpec, index: usize) -> Result<(), TaskError> {
    let data = TrajectorySource::open(attempt, &spec.data)?;
    let cells = spec.cells(data.spec());
    let missing = || TaskError::Missing { what: "cell", name: index.to_string() };
    let cell = cells.get(index).ok_or_else(missing)?;
    let scenarios = scenarios(attempt, spec, &data, cell)?;
    let checkpoints = LoadedCheckpoint::load_all(attempt, &spec.checkpoints)?;
    attempt.check_stop()?;

    let context = spec.context as usize;
    let band_edge_hz = band_edge(data.spec(), cell, &scenarios, context);
    let scoring = Scoring { context, samples: spec.samples as usize, band_edge_hz };
    let predictors = Predictors::new(spec, data.spec(), &checkpoints);
    let asked = predictors.of_cell(&scenarios, cell.first);
    let mut errors = Vec::with_capacity(asked.len());
    for (done, predictor) in (1_u64..).zip(asked.chunks(1)) {
        attempt.check_stop()?;
        errors.extend(evaluate_cell(&scenarios, &scoring, predictor));
        attempt.progress.set_done(attempt.task.total * done / asked.len() as u64);
    }
    let mut result = CellResult {
        cell: index,
        family: cell.excitation.map(|(family, _)| family),
        frequency_hz: cell.excitation.map(|(_, frequency_hz)| frequency_hz),
        first: cell.first,
        predictors: errors,
        measured_jitter_deg: measured_jitter_deg(&scenarios, &scoring),
    };
    let seed = data.spec().simulation().map(|spec| spec.seed);
    let artifact = format!("cell-{index:03}.parquet");
    let table = vec![rows::record_batch(&result, seed)?];
    let footer = rows::footer(&attempt.task.spec);
    let written = attempt.store.put_table(attempt.fence(), &artifact, table, &footer);
    let run = attempt.wait(written)?.0;
    for errors in &mut result.predictors {
        errors.scenarios.clear();
    }
    attempt.complete(&CellRecord { result, table: TableAt { run, artifact } })
}

/// The trajectories of a cell, or as many of them as there are, cut to what is asked about.
pub(super) fn scenarios(
    attempt: &Attempt,
    spec: &EvaluateSpec,
    data: &TrajectorySource,
    cell: &ScenarioCell,
) -> Result<Scenarios, TaskError> {
    let end = data.count().map_or(cell.first + cell.count, |all| all.min(cell.first + cell.count));
    let series = data.read(attempt, cell.first..end)?;
    let (context, pre_roll) = (spec.context as usize, spec.rounds() as usize);
    let samples = context + spec.horizon(data.spec().samples()) as usize;
    Ok(Scenarios {
        size: series.count(),
        samples,
        pre_roll,
        rate_hz: data.spec().rate_hz(),
        u: beginning(&series, &series.u, pre_roll + samples),
        y: beginning(&series, &series.y, pre_roll + samples),
    })
}

/// The first samples of each trajectory.
fn beginning(series: &Series, values: &[f32], samples: usize) -> Vec<f32> {
    let rows = values.chunks_exact(series.samples * JOINTS);
    rows.flat_map(|row| &row[..samples * JOINTS]).copied().collect()
}

/// Where jitter begins: above all that the cell's excitation can contain, or, where that is not known,
/// what the torques do.
fn band_edge(
    data: &DataSpec,
    cell: &ScenarioCell,
    scenarios: &Scenarios,
    context: usize,
) -> Option<f64> {
    let Scenarios { samples, pre_roll, rate_hz, .. } = *scenarios;
    let recorded = pre_roll + samples;
    let highest = match (data.simulation(), cell.excitation) {
        (Some(spec), Some((family, frequency_hz))) => {
            let duration_s = recorded as f64 / rate_hz;
            highest_component_hz(&spec.excitation, family, frequency_hz, duration_s)
        }
        _ => occupied_band_hz(&scenarios.u, recorded, rate_hz),
    };
    band_edge_hz(highest?, samples - context, rate_hz)
}
