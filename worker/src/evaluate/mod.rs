//! An evaluation: one task per cell, then the report over all of them.

mod checkpoints;
mod report;

use evaluation::metrics::{band_edge_hz, highest_component_hz, occupied_band_hz};
use evaluation::{
    CellResult, LeakyLearned, Learned, NominalArm, Predictor, Scenarios, Scoring, Start, baseline,
    evaluate_cell, measured_jitter_deg,
};
use models::Sampling;
use spec::{Cell, DataSpec, EvaluateSpec};

use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::trajectories::TrajectorySource;
use checkpoints::LoadedCheckpoint;

pub(crate) use report::report;

/// Asks every predictor for the same scenarios and keeps their errors.
pub(crate) fn cell(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: EvaluateSpec = attempt.spec()?;
    let data = TrajectorySource::open(attempt, &spec.data)?;
    let index = attempt.task.ordinal as usize;
    let cells = data.spec().cells();
    let missing = || TaskError::Missing { what: "cell", name: index.to_string() };
    let cell = cells.get(index).ok_or_else(missing)?;
    let series = data.read(attempt, cell.first..cell.first + cell.count)?;
    let scenarios = Scenarios {
        size: series.count(),
        samples: series.samples,
        pre_roll: 0,
        rate_hz: data.spec().rate_hz(),
        u: series.u,
        y: series.y,
    };
    let checkpoints = LoadedCheckpoint::load_all(attempt, &spec)?;
    attempt.check_stop()?;
    let predictors = predictors(&spec, data.spec(), &checkpoints, &scenarios);
    let context = spec.context as usize;
    let band_edge_hz = band_edge(data.spec(), cell, &scenarios, context);
    let scoring = Scoring { context, samples: 1, band_edge_hz };
    let result = CellResult {
        cell: index,
        family: cell.family,
        frequency_hz: cell.frequency_hz,
        first: cell.first,
        predictors: evaluate_cell(&scenarios, &scoring, &predictors),
        measured_jitter_deg: measured_jitter_deg(&scenarios, &scoring),
    };
    let result = serde_json::to_value(result)?;
    attempt.wait(attempt.store.complete(attempt.fence(), Some(&result)))?;
    Ok(())
}

/// Where jitter begins: above all that the cell's excitation can contain, or, of recordings, what
/// their torques do.
fn band_edge(data: &DataSpec, cell: &Cell, scenarios: &Scenarios, context: usize) -> Option<f64> {
    let Scenarios { samples, pre_roll, rate_hz, .. } = *scenarios;
    let recorded = pre_roll + samples;
    let highest = match data.simulation() {
        Some(spec) => {
            let duration_s = recorded as f64 / rate_hz;
            highest_component_hz(&spec.excitation, cell.family, cell.frequency_hz, duration_s)
        }
        None => occupied_band_hz(&scenarios.u, recorded, rate_hz),
    };
    band_edge_hz(highest?, samples - context, rate_hz)
}

/// Baselines first, then checkpoints: the order of every table.
fn predictors<'a>(
    spec: &EvaluateSpec,
    data: &DataSpec,
    checkpoints: &'a [LoadedCheckpoint],
    scenarios: &'a Scenarios,
) -> Vec<Box<dyn Predictor + 'a>> {
    let arm = NominalArm::of(data);
    let baselines = spec.baselines.iter().map(|&name| baseline(name, &arm));
    let learned = checkpoints.iter().map(|LoadedCheckpoint { info, model, .. }| {
        let name = info.name.clone();
        if model.needs_leak() {
            Box::new(LeakyLearned { name, model, scenarios }) as Box<dyn Predictor>
        } else {
            let (sampling, start) = (Sampling::default(), Start::Cold);
            Box::new(Learned { name, model, sampling, start })
        }
    });
    baselines.chain(learned).collect()
}
