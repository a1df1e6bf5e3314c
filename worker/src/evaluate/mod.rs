//! An evaluation: one task per cell, then the report over all of them.

mod checkpoints;
mod report;

use evaluation::{CellResult, LeakyLearned, Learned, Predictor, Scenarios, baseline};
use spec::{DataSpec, EvaluateSpec, JOINTS, RobotSpec};

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
        rate_hz: data.spec().rate_hz(),
        u: series.u,
        y: series.y,
    };
    let checkpoints = LoadedCheckpoint::load_all(attempt, &spec)?;
    attempt.check_stop()?;
    let predictors = predictors(&spec, data.spec(), &checkpoints, &scenarios);
    let errors = evaluation::evaluate_cell(&scenarios, spec.context as usize, &predictors)?;
    let result = CellResult {
        cell: index,
        family: cell.family,
        frequency_hz: cell.frequency_hz,
        first: cell.first,
        predictors: errors,
    };
    let result = serde_json::to_value(result)?;
    attempt.wait(attempt.store.complete(attempt.fence(), Some(&result)))?;
    Ok(())
}

/// Viscous damping that the damped integrator assumes, N·m·s/rad: that of the nominal robot.
fn nominal_damping(data: &DataSpec) -> [f64; JOINTS] {
    data.simulation()
        .map_or_else(|| RobotSpec::default().damping_nm_s_rad, |spec| spec.robot.damping_nm_s_rad)
}

/// Baselines first, then checkpoints: the order of every table.
fn predictors<'a>(
    spec: &EvaluateSpec,
    data: &DataSpec,
    checkpoints: &'a [LoadedCheckpoint],
    scenarios: &'a Scenarios,
) -> Vec<Box<dyn Predictor + 'a>> {
    let damping = nominal_damping(data);
    let baselines = spec.baselines.iter().map(|&name| baseline(name, damping));
    let learned = checkpoints.iter().map(|LoadedCheckpoint { info, model, .. }| {
        let name = info.name.clone();
        if model.needs_leak() {
            Box::new(LeakyLearned { name, model, scenarios }) as Box<dyn Predictor>
        } else {
            Box::new(Learned { name, model })
        }
    });
    baselines.chain(learned).collect()
}
