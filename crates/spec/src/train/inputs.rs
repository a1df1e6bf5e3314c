//! Checks that a training fits its data, and splits off the validation trajectories.

use super::TrainSpec;
use crate::check::Violations;
use crate::{DataSource, DataSpec, Doubt, Given, SpecError};

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

    /// Checks the training against its sources, in the order of `data`.
    ///
    /// # Errors
    /// Names each field that does not fit `data`, with both numbers.
    pub fn check_data(&self, all: &[&DataSpec]) -> Result<(), SpecError> {
        let Some(data) = all.first() else {
            return Err(SpecError::one("data", "[]", "at least one dataset or stream"));
        };
        let mut violations = Violations::default();
        self.check_alike(all, &mut violations);
        if self.given == Given::References
            && let Some(without) = all.iter().position(|data| !data.has_references())
            && let Some((field, _)) = self.data.in_field("data").get(without)
        {
            let allowed = "a simulation with a controller, to be given references";
            violations.add(field, "without references", allowed);
        }
        if let Some(weights) = &self.loss_weights {
            violations.one_per_joint("loss_weights", weights, data.joints());
        }
        if let Some(robot) = self.model.robot() {
            let told = robot.model.description().joints.len();
            if told != data.joints() {
                let allowed = format!("an arm of {} joints, as the data has", data.joints());
                violations.add("model.robot.model", format!("an arm of {told} joints"), allowed);
            }
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
        let counts = self.data.each().iter().zip(all).map(|(source, data)| match source {
            DataSource::Stream(_) => None,
            _ => data.trajectories(),
        });
        self.check_counts(&counts.collect::<Vec<_>>(), &mut violations);
        violations.finish()
    }

    /// Checks the number of trajectories of each source, in the order of `data`. `None` is a stream,
    /// which has no end, or a dataset whose number is not known yet.
    ///
    /// # Errors
    /// When a batch needs more trajectories of a source than it has for training, or early stopping
    /// has no validation trajectories.
    pub fn check_trajectories(&self, counts: &[Option<u64>]) -> Result<(), SpecError> {
        let mut violations = Violations::default();
        self.check_counts(counts, &mut violations);
        violations.finish()
    }

    /// A warning about a training that nothing validates, because the share of its trajectories rounds
    /// to 0. `counts` are as for [`Self::check_trajectories`].
    pub fn validation_doubt(&self, counts: &[Option<u64>]) -> Option<Doubt> {
        let counts = counts.iter().copied().collect::<Option<Vec<u64>>>()?;
        let is_meant = self.validation_fraction == 0.0;
        if is_meant || counts.iter().any(|all| self.validation_part(*all) > 0) {
            return None;
        }
        let largest = counts.iter().copied().max()?;
        let all: u64 = counts.iter().sum();
        let advice = match u32::try_from(largest) {
            Ok(all @ 2..) => format!("{} keeps one", least_fraction(all)),
            _ => "a validation needs two trajectories or more".to_owned(),
        };
        Some(Doubt {
            field: "validation_fraction".to_owned(),
            value: self.validation_fraction.to_string(),
            reason: format!(
                "this keeps 0 of {all} trajectories, so nothing validates the training and no checkpoint is the best; \
                 {advice}"
            ),
        })
    }

    fn check_counts(&self, counts: &[Option<u64>], violations: &mut Violations) {
        let kept = |count: &Option<u64>| count.map(|all| self.validation_part(all));
        if self.early_stop.is_some() && counts.iter().all(|count| kept(count) == Some(0)) {
            let all: u64 = counts.iter().flatten().sum();
            violations.add(
                "validation_fraction",
                self.validation_fraction,
                format!(
                    "a larger value: early_stop needs trajectories to validate with, and this \
                     keeps 0 of {all}"
                ),
            );
        }
        let fields = self.data.in_field("data");
        for (((field, _), share), count) in fields.iter().zip(self.shares()).zip(counts) {
            let Some(trained) = count.map(|all| self.training_trajectories(all)) else { continue };
            if u64::from(share) <= trained {
                continue;
            }
            let (value, of) = match fields.len() {
                1 => (share.to_string(), String::new()),
                _ => (
                    format!("{}, of which {share} are of {field}", self.batch_size),
                    format!(" of {field}"),
                ),
            };
            let allowed =
                format!("at most the number of training trajectories{of}, which is {trained}");
            violations.add("batch_size", value, allowed);
        }
    }
}

/// The least share of trajectories, in about four digits, that rounds to one of them.
fn least_fraction(all: u32) -> f64 {
    // As many digits for any number of trajectories.
    let scale = 1e4 * f64::from(10_u32.pow(all.ilog10()));
    (0.5 * scale / f64::from(all)).ceil() / scale
}
