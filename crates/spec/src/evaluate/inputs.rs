//! Checks that an evaluation fits its data and its checkpoints.

use super::sampler::{SamplingRun, Start};
use super::spec::{Baseline, EvaluateSpec};
use crate::check::{Violations, first_repeated};
use crate::{DataSpec, Given, Length, Lengths, SpecError, TrainSpec, Training};

impl EvaluateSpec {
    /// Checks the data, the trainings of the checkpoints, and the imports that hold predictions.
    ///
    /// # Errors
    /// Names each field that does not fit `data`, a training or an import, with both numbers.
    pub fn check_inputs(
        &self,
        data: &DataSpec,
        trainings: &[Training<'_>],
        predictions: &[&DataSpec],
    ) -> Result<(), SpecError> {
        let mut violations = Violations::default();
        let horizon = self.check_length(data.samples(), &mut violations);
        if self.given == Given::References && !data.has_references() {
            let allowed = "a simulation with a controller, to be given references";
            violations.add("data", "without references", allowed);
        }
        if let Some(i) = self.baselines.iter().position(|name| *name == Baseline::Oracle)
            && data.simulation().is_none()
        {
            let allowed = "left out: nobody has the robot of recordings";
            violations.add(&format!("baselines[{i}]"), "\"oracle\"", allowed);
        }
        self.check_files(data, horizon, predictions, &mut violations);
        for (i, training) in trainings.iter().enumerate() {
            let field = format!("checkpoints[{i}]");
            let lengths = training.spec.model.lengths();
            if training.spec.given != self.given {
                violations.add(
                    &field,
                    format!("trained with given {}", training.spec.given),
                    format!("given {}, as this evaluation asks", self.given),
                );
            }
            let mut same = |what: &str, found: f64, asked: f64| {
                if (found - asked).abs() > f64::EPSILON {
                    let says = match (lengths, what) {
                        (Lengths::From(_), "context" | "samples") => "answers as the nearest",
                        _ => "trained with",
                    };
                    violations.add(
                        &field,
                        format!("{says} {what} {found}"),
                        format!("{what} {asked}, as this evaluation asks"),
                    );
                }
            };
            let samples = horizon.map(|horizon| self.context + horizon);
            let asked = Length { context: self.context, samples: samples.unwrap_or_default() };
            let nearest = lengths.nearest(asked, training.length(), training.spec.model.patch());
            same("context", f64::from(nearest.context), f64::from(asked.context));
            if samples.is_some() {
                same("samples", f64::from(nearest.samples), f64::from(asked.samples));
            }
            let (trained, asked) = (training.data.rate_hz(), data.rate_hz());
            if training.spec.model.multiple(trained, asked).is_none() {
                same("rate_hz", trained, asked);
            }
            same("joints", training.data.joints() as f64, data.joints() as f64);
            self.check_runs(&field, training.spec, &mut violations);
        }
        for (i, sampler) in self.samplers.iter().enumerate() {
            if !trainings.iter().any(|training| sampler.suits(&training.spec.model)) {
                let value = sampler.kind.map_or("given".to_owned(), |kind| kind.to_string());
                let allowed = "one that some checkpoint can be sampled with";
                violations.add(&format!("samplers[{i}]"), value, allowed);
            }
        }
        violations.finish()
    }

    /// The horizon, if the trajectories are long enough.
    fn check_length(&self, samples: u32, violations: &mut Violations) -> Option<u32> {
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
        violations.add(field, value, allowed);
        None
    }

    /// Checks that a training's denoiser supports the requested samplers.
    fn check_runs(&self, checkpoint: &str, training: &TrainSpec, violations: &mut Violations) {
        let Some(generation) = training.model.generation() else { return };
        let runs = self.sampling_runs(&training.model);
        for run in &runs {
            let most = generation.most_warm_steps();
            if run.start != Start::Cold && run.steps > most {
                let limit = generation.limit_of_warm_steps();
                let value = format!("{}, for {checkpoint}", run.steps);
                violations.add(
                    "samplers.steps",
                    value,
                    format!("at most {limit}, which is {most}"),
                );
            }
            if let Err(error) = training.model.check_sampler(&run.sampler) {
                for violation in error.violations {
                    let field = violation.field.replace("sampler.", "samplers.");
                    let value = format!("{}, for {checkpoint}", violation.value);
                    violations.add(&field, value, violation.allowed);
                }
            }
        }
        let names: Vec<String> = runs.iter().map(SamplingRun::name).collect();
        if let Some(twice) = first_repeated(&names) {
            violations.add(
                "samplers",
                format!("{twice} twice"),
                format!("each once for {checkpoint}"),
            );
        }
    }
}
