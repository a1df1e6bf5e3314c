//! An evaluation: one task per cell, perhaps one for latencies, then the report over all of them.

mod cell;
mod checkpoints;
mod figures;
mod latency;
mod predictors;
mod report;
mod rows;

use spec::EvaluateSpec;

use crate::attempt::Attempt;
use crate::error::TaskError;

pub(crate) use checkpoints::LoadedCheckpoint;

/// Key of the payload of the task that measures latencies.
const LATENCY: &str = "latency";
/// Key of the payload of the tasks of cells.
const CELL: &str = "cell";

/// The task that a payload names; the report's names nothing.
pub(crate) fn evaluate(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: EvaluateSpec = attempt.spec()?;
    let asks = |key: &str| attempt.task.payload.get(key).is_some();
    if asks(CELL) {
        cell::cell(attempt, &spec)
    } else if asks(LATENCY) {
        latency::latency(attempt, &spec)
    } else {
        report::report(attempt, &spec)
    }
}
