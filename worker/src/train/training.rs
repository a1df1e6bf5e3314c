//! The course of one training: steps, validations, checkpoints, and the ways in which it ends.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use models::{ModelError, Trainer, ValidationPart, ValidationReport};
use serde_json::{Value, json};
use series::Series;
use spec::{DataSources, TrainSpec, ValidationMetric};
use store::{CheckpointFile, CheckpointId, NewCheckpoint, object_path};

use super::batches::TrainingBatch;
use super::improvement::Improvement;
use super::ranges::Ranges;
use super::recorder::Recorder;
use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::stop::StopReason;
use crate::train::described::describe;

const LOSS: &str = ValidationMetric::Loss.key();
const RMSE_DEG: &str = ValidationMetric::RmseDeg.key();

pub(super) struct Training<'a> {
    attempt: &'a Attempt,
    spec: TrainSpec,
    trainer: Trainer,
    validation: Vec<Series>,
    recorder: Recorder<'a>,
    improvement: Improvement,
    /// The last validated step.
    validated: Option<u64>,
    /// The newest checkpoint and its step.
    kept: Option<(CheckpointId, u64)>,
    kept_at: Instant,
    /// Indices of the trajectories of the newest batch, for each source of the data.
    batch: Vec<Vec<u64>>,
}

impl<'a> Training<'a> {
    /// Continues after `kept`, the newest checkpoint, from which `trainer` was made.
    pub fn new(
        attempt: &'a Attempt,
        spec: TrainSpec,
        trainer: Trainer,
        mut validation: Vec<Series>,
        kept: Option<(CheckpointId, u64)>,
    ) -> Result<Self, TaskError> {
        validation.iter_mut().for_each(|series| series.plan_from(spec.context as usize));
        let mut improvement = Improvement::new(spec.early_stop);
        let mut validated = None;
        // Values recorded after the checkpoint were deleted before.
        for (step, value) in recorded(attempt, spec.monitor)? {
            let noted = trainer.metrics().get(spec.monitor.key());
            if step == trainer.steps_done() && noted != Some(&value) {
                // This value was recorded after the checkpoint was written. It is validated once
                // more, so that the next checkpoint includes it.
                break;
            }
            improvement.observe(step, value);
            validated = Some(step);
        }
        Ok(Self {
            attempt,
            recorder: Recorder::new(attempt, spec.steps),
            trainer,
            validation,
            improvement,
            validated,
            kept,
            kept_at: Instant::now(),
            batch: Vec::new(),
            spec,
        })
    }

    /// Validates if an earlier attempt was stopped before it did, and the weights that a fine-tuning
    /// begins with. If no step improves them, they are its best checkpoint. Breaks when only the end
    /// of the training is left to do.
    pub fn resume(&mut self) -> Result<ControlFlow<()>, TaskError> {
        let step = self.trainer.steps_done();
        let is_trained = step > 0 || self.spec.init.is_some();
        let is_due = is_trained && step.is_multiple_of(self.spec.validate_every_steps);
        if is_due && self.validate()? {
            self.keep_checkpoint(CheckpointRole::Best)?;
        }
        Ok(self.continue_or_stop())
    }

    /// Takes one step and does everything that is due after it. Breaks after the last step.
    pub fn step(&mut self, mut batch: TrainingBatch) -> Result<ControlFlow<()>, TaskError> {
        batch.series.plan_from(self.spec.context as usize);
        self.stop_if_asked()?;
        let began = Instant::now();
        self.batch = batch.trajectories;
        let report = match self.trainer.step(&batch.series) {
            Ok(report) => report,
            Err(ModelError::Interrupted) => return Err(self.stopped()?),
            Err(error) => return Err(self.failed(error)),
        };
        let step = report.step;
        self.recorder.step(&report, batch.series.robots(), began);
        self.attempt.progress.set_done(step);
        if step == self.spec.steps {
            return Ok(ControlFlow::Break(()));
        }
        if step.is_multiple_of(self.spec.validate_every_steps) && self.validate()? {
            self.keep_checkpoint(CheckpointRole::Best)?;
        } else if self.is_checkpoint_due(step) {
            self.keep_checkpoint(CheckpointRole::Passing)?;
        }
        self.recorder.write_if_due()?;
        Ok(self.continue_or_stop())
    }

    fn continue_or_stop(&self) -> ControlFlow<()> {
        if self.trainer.steps_done() >= self.spec.steps || self.improvement.has_ended().is_some() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    /// Whether a checkpoint is due. The clock decides which checkpoints there are, but not what
    /// they contain.
    fn is_checkpoint_due(&self, step: u64) -> bool {
        let by_steps =
            self.spec.checkpoint_every_steps.is_some_and(|every| step.is_multiple_of(every));
        let seconds = self.spec.checkpoint_every_seconds.map(u64::from).map(Duration::from_secs);
        by_steps || seconds.is_some_and(|longest| self.kept_at.elapsed() >= longest)
    }

    pub fn finish(mut self) -> Result<(), TaskError> {
        let is_best = self.validate()?;
        self.keep_checkpoint(if is_best {
            CheckpointRole::FinalAndBest
        } else {
            CheckpointRole::Final
        })?;
        let (store, fence) = (&self.attempt.store, self.attempt.fence());
        let step = self.trainer.steps_done();
        let result = self.result();
        if step < self.spec.steps {
            tracing::info!(step, %result, "stops early");
            self.attempt.end(store.complete_early(fence, step, &result))
        } else {
            self.attempt.end(store.complete(fence, Some(&result)))
        }
    }

    /// The result of the task.
    fn result(&self) -> Value {
        let mut result = json!({"steps": self.trainer.steps_done()});
        if let Some((step, value)) = self.improvement.best() {
            result["best"] = json!({"step": step, self.spec.monitor.key(): value});
        }
        if self.trainer.steps_done() < self.spec.steps
            && let Some(validations) = self.improvement.has_ended()
        {
            result["stopped_early"] = json!({"validations_without_improvement": validations});
        }
        result
    }

    /// # Errors
    /// [`TaskError::Stopped`] when the attempt has to end. A checkpoint is written first, so the
    /// next attempt loses nothing.
    pub fn stop_if_asked(&mut self) -> Result<(), TaskError> {
        match self.attempt.stop.get() {
            None => Ok(()),
            Some(_) => Err(self.stopped()?),
        }
    }

    fn stopped(&mut self) -> Result<TaskError, TaskError> {
        let step = self.trainer.steps_done();
        let is_kept = self.kept.is_some_and(|(_, kept)| kept == step);
        let may_write = self.attempt.stop.get() != Some(StopReason::LeaseLost);
        if step > 0 && !is_kept && may_write {
            self.keep_checkpoint(CheckpointRole::Passing)?;
        }
        Ok(TaskError::Stopped)
    }

    /// Validates, and returns whether the result is the best so far. Returns false without
    /// validation trajectories, or if this step was validated before.
    fn validate(&mut self) -> Result<bool, TaskError> {
        let step = self.trainer.steps_done();
        if self.validation.is_empty() || self.validated == Some(step) {
            return Ok(false);
        }
        let mut report = ValidationReport::default();
        let mut first = 0;
        let sampled = self.spec.sampled_trajectories as usize;
        for batch in &self.validation {
            let predicted = sampled.saturating_sub(first).min(batch.robots());
            let part = ValidationPart { batch: batch.view(), first, predicted };
            match self.trainer.validate(&part) {
                Ok(part) => report += part,
                Err(ModelError::Interrupted) => return Err(self.stopped()?),
                Err(error) => return Err(error.into()),
            }
            first += batch.robots();
        }
        let rmse_deg = report.rmse_rad().to_degrees();
        for (key, value) in [(LOSS, report.loss()), (RMSE_DEG, rmse_deg)] {
            self.recorder.add(key, step, value);
            self.trainer.note(key, value);
        }
        self.validated = Some(step);
        let monitored = match self.spec.monitor {
            ValidationMetric::Loss => report.loss(),
            ValidationMetric::RmseDeg => rmse_deg,
        };
        let is_best = self.improvement.observe(step, monitored);
        tracing::info!(step, loss = report.loss(), rmse_deg, is_best, "validated");
        let best = self.improvement.best().filter(|_| !is_best);
        let note = best.map_or(String::new(), |(step, _)| format!(", best at step {step}"));
        self.attempt.progress.say(format!("validation RMSE {rmse_deg:.2}°{note}"));
        Ok(is_best)
    }

    fn keep_checkpoint(&mut self, kind: CheckpointRole) -> Result<(), TaskError> {
        let files = match self.trainer.checkpoint() {
            Ok(files) => files,
            Err(error) => return Err(self.failed(error)),
        };
        // Writes metrics first: a checkpoint never stands for steps whose metrics are lost.
        self.recorder.write()?;
        let (store, task) = (&self.attempt.store, &self.attempt.task);
        let step = self.trainer.steps_done();
        let began = Instant::now();
        let mut published = Vec::new();
        for (name, bytes) in files.into_named() {
            let path = object_path::checkpoint(task.job, step, task.fence.epoch, name);
            let object = self.attempt.wait(store.put_object(&path, bytes.into()))?;
            published.push(CheckpointFile { name: name.to_owned(), object });
        }
        let mut checkpoint = NewCheckpoint {
            step,
            is_final: matches!(kind, CheckpointRole::Final | CheckpointRole::FinalAndBest),
            is_best: matches!(kind, CheckpointRole::Best | CheckpointRole::FinalAndBest),
            metrics: self.trainer.metrics().clone(),
            files: published,
        };
        let result = checkpoint.is_final.then(|| self.result());
        describe(self.attempt, &mut checkpoint, result)?;
        let id = self.attempt.wait(store.commit_checkpoint(task.fence, &checkpoint))?;
        let bytes: u64 = checkpoint.files.iter().map(|file| file.object.size).sum();
        let seconds = began.elapsed().as_secs_f64();
        tracing::info!(checkpoint = %id, step, ?kind, bytes, seconds, "kept a checkpoint");
        self.kept = Some((id, step));
        self.kept_at = Instant::now();
        self.attempt.wait(store.prune_checkpoints(task.fence, self.spec.keep_checkpoints))?;
        Ok(())
    }

    /// Describes where non-finite numbers came from, and which checkpoint is left.
    fn failed(&mut self, error: ModelError) -> TaskError {
        let (loss, gradient_norm, step) = match error {
            ModelError::LossNotFinite { step, loss, .. } => (Some(loss), None, step),
            ModelError::GradientNotFinite { step, loss, gradient_norm, .. } => {
                (Some(loss), Some(gradient_norm), step)
            }
            ModelError::NotFiniteTensor { .. } => (None, None, self.trainer.steps_done()),
            other => return other.into(),
        };
        for (key, value) in [("train/loss", loss), ("train/gradient_norm", gradient_norm)] {
            if let Some(value) = value {
                self.recorder.add(key, step, value);
            }
        }
        if let Err(error) = self.recorder.write() {
            return error;
        }
        let checkpoint = match self.kept {
            Some((id, step)) => format!("the last good checkpoint is {id}, after step {step}"),
            None => "there was no checkpoint before".to_owned(),
        };
        let sources = self.spec.data.in_field("data");
        let of_source = |((field, _), batch): (&(String, _), &Vec<u64>)| match &self.spec.data {
            DataSources::One(_) => format!("{} of the data", Ranges(batch)),
            DataSources::Each(_) => format!("{} of {field}", Ranges(batch)),
        };
        let batch: Vec<String> = sources.iter().zip(&self.batch).map(of_source).collect();
        let batch = format!("trajectories {}", batch.join(", "));
        TaskError::Diverged { cause: error, batch, checkpoint }
    }
}

/// The kind of a checkpoint.
#[derive(Clone, Copy, Debug)]
enum CheckpointRole {
    Passing,
    Best,
    Final,
    FinalAndBest,
}

/// The recorded values of `metric`, by step.
fn recorded(attempt: &Attempt, metric: ValidationMetric) -> Result<BTreeMap<u64, f64>, TaskError> {
    let Some(run) = attempt.task.run else { return Ok(BTreeMap::new()) };
    let curve = attempt.wait(attempt.store.metric_curve(run, metric.key(), u32::MAX))?;
    Ok(curve.points.into_iter().map(|point| (point.step, point.value)).collect())
}
