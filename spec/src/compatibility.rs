//! Whether a job fits the data and the checkpoints it refers to.

use crate::check::Report;
use crate::{EvaluateSpec, SimulateSpec, SpecError, TrainSpec};

/// A training that an evaluation refers to, and the data it was trained on.
#[derive(Clone, Copy, Debug)]
pub struct Training<'a> {
    pub spec: &'a TrainSpec,
    pub data: &'a SimulateSpec,
}

impl TrainSpec {
    /// Trajectories to train on: all but the validation share at the end.
    pub fn training_trajectories(&self, data: &SimulateSpec) -> u64 {
        data.trajectories - self.validation_trajectories(data)
    }

    /// Trajectories kept for validation, rounded to the nearest whole number.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "a share of at most 10^7 trajectories is exact in f64 and not negative"
    )]
    pub fn validation_trajectories(&self, data: &SimulateSpec) -> u64 {
        (self.validation_fraction * data.trajectories as f64).round() as u64
    }

    /// # Errors
    /// Names each field that does not fit `data`, with both numbers.
    pub fn check_data(&self, data: &SimulateSpec) -> Result<(), SpecError> {
        let mut report = Report::default();
        if self.context >= data.samples {
            report.violation(
                "context",
                self.context,
                format!("less than the dataset's samples, which are {}", data.samples),
            );
        } else {
            let (horizon, patch) = (data.samples - self.context, self.model.patch());
            if !horizon.is_multiple_of(patch) {
                report.violation(
                    "model.patch",
                    patch,
                    format!("a divisor of the horizon, which is {horizon} samples"),
                );
            }
        }
        let trained = self.training_trajectories(data);
        if u64::from(self.batch_size) > trained {
            report.violation(
                "batch_size",
                self.batch_size,
                format!("at most the number of training trajectories, which is {trained}"),
            );
        }
        report.finish()
    }
}

impl EvaluateSpec {
    /// # Errors
    /// Names each field that does not fit `data` or a training, with both numbers.
    pub fn check_inputs(
        &self,
        data: &SimulateSpec,
        trainings: &[Training<'_>],
    ) -> Result<(), SpecError> {
        let mut report = Report::default();
        if data.cells().is_empty() {
            report.violation(
                "data",
                "a dataset without cells",
                "one simulated over a frequency grid",
            );
        }
        if self.context >= data.samples {
            report.violation(
                "context",
                self.context,
                format!("less than the dataset's samples, which are {}", data.samples),
            );
        }
        for (i, training) in trainings.iter().enumerate() {
            let field = format!("checkpoints[{i}]");
            let mut same = |what: &str, trained: f64, asked: f64| {
                if (trained - asked).abs() > f64::EPSILON {
                    report.violation(
                        &field,
                        format!("trained with {what} {trained}"),
                        format!("{what} {asked}, as this evaluation asks"),
                    );
                }
            };
            same("context", f64::from(training.spec.context), f64::from(self.context));
            same("samples", f64::from(training.data.samples), f64::from(data.samples));
            same("rate_hz", training.data.rate_hz, data.rate_hz);
        }
        report.finish()
    }
}
