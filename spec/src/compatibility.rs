//! Whether a job fits the data and the checkpoints it refers to.

use crate::check::Report;
use crate::evaluate::first_repeated;
use crate::{DataSource, DataSpec, EvaluateSpec, SamplingRun, SpecError, Start, TrainSpec};

/// A training that an evaluation refers to, and the data it was trained on.
#[derive(Clone, Copy, Debug)]
pub struct Training<'a> {
    pub spec: &'a TrainSpec,
    pub data: &'a DataSpec,
}

impl TrainSpec {
    /// Trajectories to train on, of a dataset with `all`: all but the validation share at the end.
    pub fn training_trajectories(&self, all: u64) -> u64 {
        all - self.validation_part(all)
    }

    /// Trajectories kept for validation, of a dataset with `all`, rounded to the nearest whole number.
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
        let mut report = Report::default();
        let samples = data.samples();
        if self.context >= samples {
            report.violation(
                "context",
                self.context,
                format!("less than the data's samples, which are {samples}"),
            );
        } else {
            let (horizon, patch) = (samples - self.context, self.model.patch());
            if !horizon.is_multiple_of(patch) {
                report.violation(
                    "model.patch",
                    patch,
                    format!("a divisor of the horizon, which is {horizon} samples"),
                );
            }
        }
        let stride = self.model.stride();
        if !samples.is_multiple_of(stride) {
            report.violation(
                "model",
                format!("a U-Net of stride {stride}"),
                format!("one whose stride divides the data's samples, which are {samples}"),
            );
        }
        if let (Some(all), false) =
            (data.trajectories(), matches!(self.data, DataSource::Stream(_)))
        {
            self.check_count(all, &mut report);
        }
        report.finish()
    }

    /// For data of which [`DataSpec::trajectories`] did not tell how many there are.
    ///
    /// # Errors
    /// When a batch needs more trajectories than there are to train on, or an early stop has none
    /// to look at.
    pub fn check_trajectories(&self, all: u64) -> Result<(), SpecError> {
        let mut report = Report::default();
        self.check_count(all, &mut report);
        report.finish()
    }

    fn check_count(&self, all: u64, report: &mut Report) {
        if self.early_stop.is_some() && self.validation_part(all) == 0 {
            report.violation(
                "validation_fraction",
                self.validation_fraction,
                format!(
                    "so large that early_stop has trajectories to validate with: here it keeps 0 of {all}"
                ),
            );
        }
        let trained = self.training_trajectories(all);
        if u64::from(self.batch_size) > trained {
            report.violation(
                "batch_size",
                self.batch_size,
                format!("at most the number of training trajectories, which is {trained}"),
            );
        }
    }
}

impl EvaluateSpec {
    /// # Errors
    /// Names each field that does not fit `data` or a training, with both numbers.
    pub fn check_inputs(
        &self,
        data: &DataSpec,
        trainings: &[Training<'_>],
    ) -> Result<(), SpecError> {
        let mut report = Report::default();
        let horizon = self.check_length(data.samples(), &mut report);
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
            if let Some(horizon) = horizon {
                let samples = self.context + horizon;
                same("samples", f64::from(training.data.samples()), f64::from(samples));
            }
            same("rate_hz", training.data.rate_hz(), data.rate_hz());
            self.check_runs(&field, training.spec, &mut report);
        }
        for (i, sampler) in self.samplers.iter().enumerate() {
            if !trainings.iter().any(|training| sampler.suits(&training.spec.model)) {
                let value = sampler.kind.map_or("given".to_owned(), |kind| kind.to_string());
                let allowed = "one that some checkpoint can be sampled with";
                report.violation(&format!("samplers[{i}]"), value, allowed);
            }
        }
        report.finish()
    }

    /// The horizon, of trajectories that are long enough.
    fn check_length(&self, samples: u32, report: &mut Report) -> Option<u32> {
        let rounds = self.rounds();
        let horizon = self.horizon(samples).max(1);
        let needed = [self.context, rounds, horizon].into_iter().fold(0, u32::saturating_add);
        if needed <= samples {
            return Some(horizon);
        }
        let field = match (self.horizon, rounds) {
            _ if self.context >= samples => "context",
            (None, 0) => "context",
            (Some(_), 0) => "horizon",
            _ => "rounds",
        };
        let value = match field {
            "context" => self.context,
            "horizon" => horizon,
            _ => rounds,
        };
        let allowed = format!(
            "less than the data's samples, which are {samples}: {rounds} rounds, {} of context and \
             {horizon} of horizon need {needed}",
            self.context
        );
        report.violation(field, value, allowed);
        None
    }

    /// Whether a training's denoiser can be sampled as this evaluation asks.
    fn check_runs(&self, checkpoint: &str, training: &TrainSpec, report: &mut Report) {
        let Some(generation) = training.model.generation() else { return };
        let runs = self.sampling_runs(&training.model);
        for run in &runs {
            let most = generation.most_warm_steps();
            if run.start != Start::Cold && run.steps > most {
                let limit = generation.limit_of_warm_steps();
                let value = format!("{}, for {checkpoint}", run.steps);
                report.violation(
                    "samplers.steps",
                    value,
                    format!("at most {limit}, which is {most}"),
                );
            }
            if let Err(error) = training.model.check_sampler(&run.sampler) {
                for violation in error.violations {
                    let field = violation.field.replace("sampler.", "samplers.");
                    let value = format!("{}, for {checkpoint}", violation.value);
                    report.violation(&field, value, violation.allowed);
                }
            }
        }
        let names: Vec<String> = runs.iter().map(SamplingRun::name).collect();
        if let Some(twice) = first_repeated(&names) {
            report.violation(
                "samplers",
                format!("{twice} twice"),
                format!("each once for {checkpoint}"),
            );
        }
    }
}
