//! Trainings: from the newest checkpoint, or from the beginning, to the last step. The beginning is
//! the weights of a seed, or those of another training's checkpoint.
//!
//! A thread reads ahead and assembles batches while `models` steps.
//!
//! - The batch of a step is a function of (seed, step) alone, so a resumed training needs no
//!   cursor, only its step. On a stream, step `s` has trajectories `s·B` to `(s+1)·B`. Of several
//!   sources, each gives the same number of trajectories to every batch.
//! - Validation uses the last trajectories, which are never trained on; on a stream those from 2^40
//!   on, which no training reaches.
//! - The state of an early stop is a function of the recorded validations, and is replayed on
//!   resuming. Time decides only which checkpoints there are.
//! - The ranges of all batches so far are part of a checkpoint. Least and largest values do not
//!   depend on order, so a stream and a dataset of the same trajectories have the same ranges.
//! - There are two copies between a decoded row group and a tensor: `series::Series::gather` takes
//!   the robots of a batch out of the decoded columns, and `models` normalizes the batch into the
//!   tensor.

mod batches;
mod course;
mod described;
mod improvement;
mod order;
mod ranges;
mod recorder;
mod takeover;
mod training;

use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::Duration;

use models::{
    CONFIG_FILE, CheckpointFiles, InitialCheckpoint, MODEL_FILE, OPTIMIZER_FILE, Statistics,
    Trainer, TrainingData,
};
use spec::{Normalization, TrainSpec};
use store::Checkpoint;

use crate::attempt::Attempt;
use crate::checkpoint::{self, FoundCheckpoint};
use crate::error::TaskError;
use crate::kinds::KindModule;
use course::Course;
use training::Training;

/// Number of batches that are read ahead.
const READ_AHEAD: usize = 4;

/// Pause between two checks for a reason to stop, while waiting for the next batch.
const LOOK_EVERY: Duration = Duration::from_millis(100);

pub(crate) const MODULE: KindModule = KindModule { run, computes_models: true };

/// Trains, writes checkpoints, and ends with the final one.
fn run(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: TrainSpec = attempt.spec()?;
    let course = Course::open(attempt, &spec)?;
    takeover::take_over(attempt, |checkpoint| resume(attempt, &spec, &course, checkpoint))?;
    let (trainer, latest) = trainer(attempt, &spec, &course)?;
    let trainer = trainer.interrupted_by(attempt.stop.interrupt().clone());
    let first = trainer.steps_done();
    let checkpoint = latest.as_ref().map(|checkpoint| checkpoint.id.0);
    tracing::info!(step = first, steps = spec.steps, checkpoint, "trains from here");
    attempt.wait(attempt.store.delete_metrics_after(attempt.fence(), first))?;
    attempt.progress.begin_at(first);

    let validation = course.validation(attempt)?;
    let kept = latest.map(|checkpoint| (checkpoint.id, checkpoint.step));
    let end = spec.steps;
    let mut training = Training::new(attempt, spec, trainer, validation, kept)?;
    if training.resume()?.is_continue() {
        thread::scope(|scope| {
            let (send, receive) = sync_channel(READ_AHEAD);
            scope.spawn(|| course.send_batches(attempt, first, end, &{ send }));
            loop {
                let going_on = match receive.recv_timeout(LOOK_EVERY) {
                    Ok(Ok(batch)) => training.step(batch)?,
                    Err(RecvTimeoutError::Disconnected) => break,
                    // The thread that makes batches noticed the stop first.
                    Ok(Err(TaskError::Stopped)) | Err(RecvTimeoutError::Timeout) => {
                        training.stop_if_asked()?;
                        continue;
                    }
                    Ok(Err(error)) => return Err(error),
                };
                if going_on.is_break() {
                    break;
                }
            }
            Ok(())
        })?;
    }
    training.finish()
}

/// Resumes from the newest undamaged checkpoint, which it also returns, or begins anew. Newer,
/// damaged checkpoints are discarded: the same steps make them again.
fn trainer(
    attempt: &Attempt,
    spec: &TrainSpec,
    course: &Course,
) -> Result<(Trainer, Option<Checkpoint>), TaskError> {
    let store = &attempt.store;
    let mut checkpoints = attempt.wait(store.checkpoints_of_job(attempt.task.job))?;
    while let Some(checkpoint) = checkpoints.pop() {
        match resume(attempt, spec, course, &checkpoint) {
            Ok(trainer) => return Ok((trainer, Some(checkpoint))),
            Err(TaskError::Store(error)) if error.is_unusable_object() => {
                let error = spec::causes(&error);
                tracing::warn!(step = checkpoint.step, error, "discards a checkpoint");
                attempt.wait(store.discard_checkpoint(attempt.fence(), checkpoint.id))?;
            }
            Err(error) => return Err(error),
        }
    }
    let digest = attempt.task.digest.to_string();
    let limits = course.data().limits_rad();
    if let Some(init) = &spec.init {
        let FoundCheckpoint { checkpoint, .. } = checkpoint::find(attempt, init)?;
        let read = |name| checkpoint::read(attempt, &checkpoint, name);
        let init = InitialCheckpoint { model: read(MODEL_FILE)?, config: read(CONFIG_FILE)? };
        let (id, step) = (checkpoint.id.0, checkpoint.step);
        tracing::info!(checkpoint = id, step, "begins with the weights of a checkpoint");
        let data = training_data(course, None);
        let trainer = Trainer::fine_tune(spec, data, &digest, &init, &attempt.device)?;
        return Ok((trainer.with_limits(limits), None));
    }
    let statistics = match spec.normalization {
        Normalization::Dataset => Some(course.statistics(attempt)?),
        Normalization::Context | Normalization::PaperLeaky | Normalization::None => None,
    };
    let trainer = Trainer::new(spec, training_data(course, statistics), &digest, &attempt.device)?;
    Ok((trainer.with_limits(limits), None))
}

/// Resumes from a checkpoint.
fn resume(
    attempt: &Attempt,
    spec: &TrainSpec,
    course: &Course,
    checkpoint: &Checkpoint,
) -> Result<Trainer, TaskError> {
    let files = read_checkpoint(attempt, checkpoint)?;
    let digest = attempt.task.digest.to_string();
    let data = training_data(course, None);
    let trainer = Trainer::resume(spec, data, &digest, &files, &attempt.device)?;
    Ok(trainer.with_limits(course.data().limits_rad()))
}

fn training_data(course: &Course, statistics: Option<Statistics>) -> TrainingData {
    let data = course.data();
    let (samples, joints, rate_hz) = (data.samples(), data.joints(), data.rate_hz());
    TrainingData { samples, joints, rate_hz, statistics }
}

fn read_checkpoint(
    attempt: &Attempt,
    checkpoint: &Checkpoint,
) -> Result<CheckpointFiles, TaskError> {
    let read = |name| checkpoint::read(attempt, checkpoint, name);
    Ok(CheckpointFiles {
        model: read(MODEL_FILE)?,
        optimizer: read(OPTIMIZER_FILE)?,
        config: read(CONFIG_FILE)?,
    })
}
