//! The predictors of an evaluation, in the order of every table: baselines, then files of
//! predictions, then checkpoints with each of their samplers.

use std::collections::HashMap;

use evaluation::{
    FirstPrediction, KnownController, LeakyLearned, Learned, NominalArm, Oracle, OracleStarted,
    Predictor, Simulated, Start, baseline, prior_knowledge,
};
use models::Sampling;
use series::SeriesView;
use spec::{Baseline, DataSpec, EvaluateSpec, Given, SamplerSpec, SamplingRun, SpecError};
use wire::{PredictorInfo, PredictorKind, SamplingInfo};

use super::checkpoints::LoadedCheckpoint;
use super::predictions::PredictionFile;

/// Distance of two windows in samples. As in the paper, there is a prediction at every sample.
pub(super) const SHIFT: usize = 1;

pub(super) struct Predictors<'a> {
    arm: NominalArm,
    data: &'a DataSpec,
    spec: &'a EvaluateSpec,
    files: &'a [PredictionFile],
    pub learned: Vec<LearnedRun<'a>>,
    /// First predictions of warm-started runs that share a checkpoint and a sampler.
    first: HashMap<FirstKey, FirstPrediction>,
}

/// A checkpoint and, where the spec asks for one, its sampler.
pub(super) struct LearnedRun<'a> {
    pub info: PredictorInfo,
    pub checkpoint: &'a LoadedCheckpoint,
    pub run: Option<SamplingRun>,
    index: usize,
}

/// Index of the checkpoint, and everything else that determines a prediction without a warm start.
type FirstKey = (usize, String);

impl<'a> Predictors<'a> {
    pub fn new(
        spec: &'a EvaluateSpec,
        data: &'a DataSpec,
        files: &'a [PredictionFile],
        checkpoints: &'a [LoadedCheckpoint],
    ) -> Result<Self, SpecError> {
        let learned: Vec<LearnedRun<'a>> = checkpoints
            .iter()
            .enumerate()
            .flat_map(|(index, checkpoint)| LearnedRun::all(spec, index, checkpoint))
            .collect();
        let first = learned
            .iter()
            .map(|predictor| (predictor.first_key(), FirstPrediction::new()))
            .collect();
        let predictors = Self { arm: NominalArm::of(data), data, spec, files, learned, first };
        predictors.check_names()?;
        Ok(predictors)
    }

    /// Refuses a file whose name is also that of a checkpoint, which is known only once the checkpoint is loaded.
    fn check_names(&self) -> Result<(), SpecError> {
        for (i, file) in self.files.iter().enumerate() {
            let name = &file.info.name;
            if self.learned.iter().any(|learned| learned.info.name == *name) {
                let allowed = "another name than that of a checkpoint of this evaluation";
                let field = format!("predictions[{i}].name");
                return Err(SpecError::one(field, format!("{name:?}"), allowed));
            }
        }
        Ok(())
    }

    /// The predictors, in the order of every table.
    pub fn infos(&self) -> Vec<PredictorInfo> {
        let baselines = self.spec.baselines.iter().map(|&name| PredictorInfo {
            name: baseline(name, &self.arm).name().to_owned(),
            kind: PredictorKind::Baseline,
            told: Some(prior_knowledge(name, self.spec.given, self.data)),
            digest: None,
            file: None,
            replicates: None,
            normalization: None,
            sampling: None,
            latency: None,
        });
        let files = self.files.iter().map(|file| file.info.clone());
        let learned = self.learned.iter().map(|learned| learned.info.clone());
        baselines.chain(files).chain(learned).collect()
    }

    /// For the scenarios of one cell, `first` the index of the first, with what the files say of them,
    /// and with what a simulation knows of them.
    pub fn of_cell<'b>(
        &'b self,
        scenarios: &'b SeriesView<'b>,
        first: u64,
        answers: Vec<evaluation::Given>,
        simulated: Option<&Simulated>,
    ) -> Vec<Box<dyn Predictor + 'b>> {
        let baselines = self.spec.baselines.iter().map(|&name| -> Box<dyn Predictor + 'b> {
            match (name, self.spec.given, simulated) {
                (Baseline::Oracle, Given::Torques, _) => {
                    Box::new(Oracle::new(&self.arm, simulated))
                }
                (Baseline::Oracle, Given::References, Some(simulated)) => {
                    Box::new(KnownController::with_robot(simulated))
                }
                (Baseline::NominalSimulator, Given::References, Some(simulated)) => {
                    Box::new(KnownController::with_nominal_arm(simulated))
                }
                (name, ..) => baseline(name, &self.arm),
            }
        });
        let learned = self.learned.iter().map(|learned| self.predictor(learned, scenarios, first));
        let answers = answers.into_iter().map(|it| -> Box<dyn Predictor + 'b> { Box::new(it) });
        baselines.chain(answers).chain(learned).collect()
    }

    fn predictor<'b>(
        &'b self,
        learned: &'b LearnedRun<'a>,
        scenarios: &'b SeriesView<'b>,
        first: u64,
    ) -> Box<dyn Predictor + 'b> {
        let (name, model) = (learned.info.name.clone(), &learned.checkpoint.model);
        if model.needs_leak() {
            return Box::new(LeakyLearned { name, model, scenarios });
        }
        let sampling = learned.sampling(self.spec, first);
        let start = match learned.run.as_ref().map(|run| (run.start, run.steps)) {
            Some((spec::Start::Oracle, steps)) => {
                return Box::new(OracleStarted { name, model, sampling, steps, scenarios });
            }
            Some((spec::Start::Shifted, steps)) => Start::Shifted { shift: SHIFT, steps },
            Some((spec::Start::Cold, _)) | None => Start::Cold,
        };
        let first = self.first.get(&learned.first_key());
        Box::new(Learned { name, model, sampling, start, first })
    }
}

impl<'a> LearnedRun<'a> {
    fn all(spec: &EvaluateSpec, index: usize, checkpoint: &'a LoadedCheckpoint) -> Vec<Self> {
        let model = checkpoint.model.architecture();
        // Statistics of the horizon require the training's own sampler.
        let runs =
            if checkpoint.model.needs_leak() { Vec::new() } else { spec.sampling_runs(model) };
        if runs.is_empty() {
            let own =
                model.generation().zip(model.sampler()).map(|(generation, own)| SamplingInfo {
                    curve: checkpoint.info.name.clone(),
                    kind: own.kind,
                    steps: own.steps.unwrap_or(generation.all_steps()),
                    start: spec::Start::Cold,
                });
            let info = PredictorInfo { sampling: own, ..checkpoint.info.clone() };
            return vec![Self { info, checkpoint, run: None, index }];
        }
        let each = runs.into_iter().map(|run| {
            let name = &checkpoint.info.name;
            let sampling = SamplingInfo {
                curve: format!("{name} {}", run.curve()),
                kind: run.sampler.kind,
                steps: run.steps,
                start: run.start,
            };
            let info = PredictorInfo {
                name: format!("{name} {}", run.name()),
                sampling: Some(sampling),
                ..checkpoint.info.clone()
            };
            Self { info, checkpoint, run: Some(run), index }
        });
        each.collect()
    }

    /// Sampling options for the scenarios from `first` on, without samples and warm start.
    pub fn sampling(&self, spec: &EvaluateSpec, first: u64) -> Sampling {
        let sampler: Option<SamplerSpec> = self.run.as_ref().map(|run| run.sampler);
        Sampling { sampler, seed: spec.seed, first_scenario: first, ..Sampling::default() }
    }

    fn first_key(&self) -> FirstKey {
        (self.index, format!("{:?}", self.run.as_ref().map(|run| run.sampler)))
    }
}
