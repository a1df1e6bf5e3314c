//! An evaluation: one task per cell, perhaps one for latencies, then the report over all of them.

mod cell;
mod checkpoints;
mod examples;
mod figures;
mod latency;
mod predictions;
mod predictors;
mod recordings;
mod renames;
mod report;
mod rows;

use jobs::EvaluateTask;
use spec::EvaluateSpec;

use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::kinds::KindModule;

pub(crate) use checkpoints::LoadedCheckpoint;

pub(crate) const MODULE: KindModule = KindModule { run, computes_models: true };

fn run(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: EvaluateSpec = attempt.spec()?;
    match attempt.payload()? {
        EvaluateTask::Cell(index) => cell::cell(attempt, &spec, index as usize),
        EvaluateTask::Latency => latency::latency(attempt, &spec),
        EvaluateTask::Report => report::report(attempt, &spec),
    }
}
