//! An evaluation: one task per cell, perhaps one for latencies, then the report over all of them.
//!
//! Each cell asks all predictors for the same scenarios. It keeps the errors of every scenario,
//! joint by joint, in a table, and the rest as the task's result. The report task reads the tables
//! back, so there is one form of the measurements, the one that people download. A predictor
//! without an answer is part of it and stops no other. The errors of a scenario do not depend on
//! the other scenarios of the question. Latencies are a separate task after the cells, because they
//! depend on what else runs. Whether a cell is in or out of distribution is derived from the specs
//! of the checkpoints' trainings, never typed in.
//!
//! A file of foreign predictions is an imported dataset, so it is kept, deleted and reindexed like
//! any other. A cell finds its scenarios by the names of recordings and compares the torques.

mod cell;
mod checkpoints;
mod examples;
mod figures;
mod latency;
mod pace;
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
