//! Checks that a training fits its data, and splits off the validation trajectories.

use super::TrainSpec;
use crate::check::Violations;
use crate::{DataSource, DataSpec, SpecError};

impl TrainSpec {
    /// Number of training trajectories of a dataset with `all`: all except the validation share at
    /// the end.
    pub fn training_trajectories(&self, all: u64) -> u64 {
        all - self.validation_part(all)
    }

    /// Number of validation trajectories of a dataset with `all`, rounded to the nearest integer.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "a share of at most 2^31 trajectories is exact in f64 and not negative"
    )]
    pub fn validation_part(&self, all: u64) -> u64 {
        (self.validation_fraction * all as f64).round() as u64
    }

    /// # Errors
    /// Names each field that does not fit `data`, with both numbers.
    pub fn check_data(&self, data: &DataSpec) -> Result<(), SpecError> {
        let mut violations = Violations::default();
        if let Some(weights) = &self.loss_weights {
            violations.one_per_joint("loss_weights", weights, data.joints());
        }
        let samples = data.samples();
        if self.context >= samples {
            violations.add(
                "context",
                self.context,
                format!("less than the data's samples, which are {samples}"),
            );
        } else {
            let (horizon, patch) = (samples - self.context, self.model.patch());
            if !horizon.is_multiple_of(patch) {
                violations.add(
                    "model.patch",
                    patch,
                    format!("a divisor of the horizon, which is {horizon} samples"),
                );
            }
        }
        let stride = self.model.stride();
        if !samples.is_multiple_of(stride) {
            violations.add(
                "model",
                format!("a U-Net of stride {stride}"),
                format!("one whose stride divides the data's samples, which are {samples}"),
            );
        }
        if let (Some(all), false) =
            (data.trajectories(), matches!(self.data, DataSource::Stream(_)))
        {
            self.check_count(all, &mut violations);
        }
        violations.finish()
    }

    /// Checks data whose number of trajectories [`DataSpec::trajectories`] did not know.
    ///
    /// # Errors
    /// When a batch needs more trajectories than there are for training, or early stopping has no
    /// validation trajectories.
    pub fn check_trajectories(&self, all: u64) -> Result<(), SpecError> {
        let mut violations = Violations::default();
        self.check_count(all, &mut violations);
        violations.finish()
    }

    fn check_count(&self, all: u64, violations: &mut Violations) {
        if self.early_stop.is_some() && self.validation_part(all) == 0 {
            violations.add(
                "validation_fraction",
                self.validation_fraction,
                format!(
                    "a larger value: early_stop needs trajectories to validate with, and this \
                     keeps 0 of {all}"
                ),
            );
        }
        let trained = self.training_trajectories(all);
        if u64::from(self.batch_size) > trained {
            violations.add(
                "batch_size",
                self.batch_size,
                format!("at most the number of training trajectories, which is {trained}"),
            );
        }
    }
}
