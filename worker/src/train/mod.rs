//! A training: from its newest checkpoint, or from the beginning, to its last step.

mod batches;
mod course;
mod order;

use std::collections::VecDeque;
use std::sync::mpsc::sync_channel;
use std::thread;
use std::time::Instant;

use models::{Batch, CheckpointFiles, Device};
use models::{CONFIG_FILE, MODEL_FILE, OPTIMIZER_FILE, Trainer, TrainingData};
use spec::{Normalization, TrainSpec};
use store::{Checkpoint, CheckpointFile, Metric, NewCheckpoint, object_path};

use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::stop::StopReason;
use course::Course;

/// Batches kept ready.
const READ_AHEAD: usize = 4;
/// Values recorded per metric over a whole training, at most.
const RECORDED_STEPS: u64 = 2000;
/// Seconds between two writes of metrics.
const RECORD_INTERVAL: f32 = 1.0;
/// Checkpoints kept besides the final one.
const KEPT_CHECKPOINTS: u32 = 2;

/// Trains, keeps checkpoints, and ends with the final one.
pub(crate) fn train(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: TrainSpec = attempt.spec()?;
    let course = Course::open(attempt, &spec)?;
    let trainer = trainer(attempt, &spec, &course)?;
    let first = trainer.steps_done();
    attempt.wait(attempt.store.delete_metrics_after(attempt.fence(), first))?;
    attempt.progress.begin_at(first);

    let mut training = Training {
        attempt,
        validation: course.validation(attempt)?,
        recorder: Recorder::new(attempt, spec.steps),
        trainer,
        spec,
    };
    let end = training.spec.steps;
    thread::scope(|scope| {
        let (send, receive) = sync_channel(READ_AHEAD);
        scope.spawn(|| course.send_batches(first, end, &{ send }));
        for batch in receive {
            training.step(&batch?)?;
        }
        training.finish()
    })
}

fn trainer(attempt: &Attempt, spec: &TrainSpec, course: &Course) -> Result<Trainer, TaskError> {
    let digest = attempt.task.digest.to_string();
    let device = Device::cpu();
    let (samples, rate_hz) = (course.data().samples(), course.data().rate_hz());
    let data_of = |statistics| TrainingData { samples, rate_hz, statistics };
    let latest = attempt.wait(attempt.store.latest_checkpoint(attempt.task.job))?;
    if let Some(checkpoint) = latest {
        let files = read_checkpoint(attempt, &checkpoint)?;
        return Ok(Trainer::resume(spec, data_of(None), &digest, &files, &device)?);
    }
    let statistics = match spec.normalization {
        Normalization::Dataset => Some(course.statistics(attempt)?),
        Normalization::Context | Normalization::PaperLeaky => None,
    };
    Ok(Trainer::new(spec, data_of(statistics), &digest, &device)?)
}

fn read_checkpoint(
    attempt: &Attempt,
    checkpoint: &Checkpoint,
) -> Result<CheckpointFiles, TaskError> {
    let read = |name: &'static str| {
        let missing =
            || TaskError::Missing { what: "a file of the checkpoint:", name: name.to_owned() };
        let object = checkpoint.file(name).ok_or_else(missing)?;
        Ok::<_, TaskError>(attempt.wait(attempt.store.read_object(object))?.to_vec())
    };
    Ok(CheckpointFiles {
        model: read(MODEL_FILE)?,
        optimizer: read(OPTIMIZER_FILE)?,
        config: read(CONFIG_FILE)?,
    })
}

struct Training<'a> {
    attempt: &'a Attempt,
    spec: TrainSpec,
    trainer: Trainer,
    validation: Vec<Batch>,
    recorder: Recorder<'a>,
}

impl Training<'_> {
    fn step(&mut self, batch: &Batch) -> Result<(), TaskError> {
        self.stop_if_asked()?;
        let report = self.trainer.step(batch)?;
        let step = report.step;
        self.recorder.step_done(step, batch.size);
        if self.recorder.is_recorded(step) {
            self.recorder.add("train/loss", step, report.loss);
            self.recorder.add("train/gradient_norm", step, report.gradient_norm);
            self.recorder.add("train/learning_rate", step, report.learning_rate);
        }
        self.attempt.progress.set_done(step);
        if step == self.spec.steps {
            return Ok(());
        }
        if step.is_multiple_of(self.spec.validate_every_steps) {
            self.validate()?;
        }
        if step.is_multiple_of(self.spec.checkpoint_every_steps) {
            self.keep_checkpoint(false)?;
        }
        self.recorder.write_if_due()
    }

    fn finish(mut self) -> Result<(), TaskError> {
        self.validate()?;
        self.keep_checkpoint(true)?;
        self.attempt.wait(self.attempt.store.complete(self.attempt.fence(), None))?;
        Ok(())
    }

    /// A checkpoint where it stands, so that whoever goes on loses nothing.
    fn stop_if_asked(&mut self) -> Result<(), TaskError> {
        match self.attempt.stop.get() {
            None => Ok(()),
            Some(StopReason::LeaseLost) => Err(TaskError::Stopped),
            Some(StopReason::Shutdown | StopReason::Cancelled) => {
                if self.trainer.steps_done() > 0 {
                    self.keep_checkpoint(false)?;
                }
                Err(TaskError::Stopped)
            }
        }
    }

    fn validate(&mut self) -> Result<(), TaskError> {
        if self.validation.is_empty() {
            return Ok(());
        }
        let (mut loss, mut rmse_rad, mut trajectories) = (0.0, 0.0, 0.0);
        for batch in &self.validation {
            let report = self.trainer.validate(batch)?;
            let weight = batch.size as f64;
            loss += weight * report.loss;
            rmse_rad += weight * report.rmse_rad;
            trajectories += weight;
        }
        let step = self.trainer.steps_done();
        let rmse_deg = (rmse_rad / trajectories).to_degrees();
        self.attempt.progress.say(format!("validation RMSE {rmse_deg:.2}°"));
        self.recorder.add("validation/loss", step, loss / trajectories);
        self.recorder.add("validation/rmse_deg", step, rmse_deg);
        Ok(())
    }

    fn keep_checkpoint(&mut self, is_final: bool) -> Result<(), TaskError> {
        // Metrics first: a checkpoint never stands for steps whose metrics are lost.
        self.recorder.write()?;
        let (store, task) = (&self.attempt.store, &self.attempt.task);
        let step = self.trainer.steps_done();
        let mut files = Vec::new();
        for (name, bytes) in self.trainer.checkpoint()?.named() {
            let path = object_path::checkpoint(task.job, step, task.fence.epoch, name);
            let object = self.attempt.wait(store.put_object(&path, bytes.to_vec().into()))?;
            files.push(CheckpointFile { name: name.to_owned(), object });
        }
        let checkpoint = NewCheckpoint { step, is_final, files };
        self.attempt.wait(store.commit_checkpoint(task.fence, &checkpoint))?;
        self.attempt.wait(store.prune_checkpoints(task.fence, KEPT_CHECKPOINTS))?;
        Ok(())
    }
}

/// Metrics on their way to the store, in batches.
struct Recorder<'a> {
    attempt: &'a Attempt,
    pending: Vec<Metric>,
    written: Instant,
    /// Every how many steps the metrics of a step are recorded.
    every: u64,
    /// When each of the last steps ended, and the trajectories it took.
    recent: VecDeque<(Instant, usize)>,
}

impl<'a> Recorder<'a> {
    fn new(attempt: &'a Attempt, steps: u64) -> Self {
        Self {
            attempt,
            pending: Vec::new(),
            written: Instant::now(),
            every: steps.div_ceil(RECORDED_STEPS),
            recent: VecDeque::new(),
        }
    }

    fn is_recorded(&self, step: u64) -> bool {
        step == 1 || step.is_multiple_of(self.every)
    }

    fn add(&mut self, key: &str, step: u64, value: f64) {
        self.pending.push(Metric { key: key.to_owned(), step, value });
    }

    /// Notes the pace, which is recorded as the mean over the last steps.
    fn step_done(&mut self, step: u64, trajectories: usize) {
        const STEPS: usize = 50;
        self.recent.push_back((Instant::now(), trajectories));
        if self.recent.len() > STEPS {
            self.recent.pop_front();
        }
        if let (true, Some((start, _))) = (self.is_recorded(step), self.recent.front()) {
            let seconds = start.elapsed().as_secs_f64();
            let trajectories: usize = self.recent.iter().skip(1).map(|(_, count)| count).sum();
            if trajectories > 0 && seconds > 0.0 {
                self.add("train/samples_per_second", step, trajectories as f64 / seconds);
            }
        }
    }

    fn write_if_due(&mut self) -> Result<(), TaskError> {
        if self.written.elapsed().as_secs_f32() < RECORD_INTERVAL {
            return Ok(());
        }
        self.write()
    }

    fn write(&mut self) -> Result<(), TaskError> {
        self.written = Instant::now();
        if self.pending.is_empty() {
            return Ok(());
        }
        let store = &self.attempt.store;
        self.attempt.wait(store.record_metrics(self.attempt.fence(), &self.pending))?;
        self.pending.clear();
        Ok(())
    }
}
