//! The results of a study, from which its report is made.

use serde::Serialize;
use spec::{
    Digest, Family, PipelineSpec, StudyEdition, StudyEvaluation, StudyQuestion, StudyScale,
    StudyTraining,
};
use wire::{PredictorInfo, Report, Shift, ShiftScores, ShiftSummary};

/// The results of a study.
#[derive(Debug)]
pub struct Study {
    /// The question that it puts to models.
    pub edition: StudyEdition,
    /// The scale at which it ran.
    pub scale: StudyScale,
    /// Every job, with all defaults filled in.
    pub spec: PipelineSpec,
    /// The pipeline's job.
    pub pipeline: JobRecord,
    /// Its trainings, in the order of its plan.
    pub trainings: Vec<Training>,
    /// Its evaluations, in the order of its plan.
    pub evaluations: Vec<Evaluation>,
}

/// The record of a job that computed numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JobRecord {
    /// The job's name in the pipeline.
    pub name: String,
    /// The job's id on the server that computed it.
    pub job: i64,
    /// The digest of its spec, which covers everything that it was made from.
    pub digest: Digest,
    /// Seconds from start to end, on the machine that computed it.
    pub seconds: Option<f64>,
    /// Whether it was computed before this study was submitted.
    pub reused: bool,
}

/// A finished training of the study.
#[derive(Debug)]
pub struct Training {
    /// Its model, set and seed.
    pub plan: StudyTraining,
    /// Its job.
    pub record: JobRecord,
    /// The id of its last checkpoint, which the evaluations use.
    pub checkpoint: i64,
    /// SHA-256 of that checkpoint's weights, in hexadecimal.
    pub sha256: String,
    /// Optimizer steps of that checkpoint.
    pub steps: u64,
    /// RMSE on the validation robots at that checkpoint, in degrees. `None` without a validation.
    pub validation_rmse_deg: Option<f64>,
}

/// A finished evaluation of the study.
#[derive(Debug)]
pub struct Evaluation {
    /// Its question and set.
    pub plan: StudyEvaluation,
    /// Its job.
    pub record: JobRecord,
    /// The numbers.
    pub report: Report,
    /// Its report as JSON; all files that it left if its question is drawn.
    pub files: Vec<File>,
}

/// A file that an evaluation left.
#[derive(Debug)]
pub struct File {
    /// Its name in the list of the evaluation's files, such as `report.json`.
    pub name: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

impl Study {
    /// The number of training sets, beginning with D1.
    pub(crate) fn sets(&self) -> usize {
        self.evaluations.iter().map(|evaluation| evaluation.plan.set).max().unwrap_or(0)
    }

    /// The name of a training set, counted from 1.
    pub(crate) fn set_name(&self, set: usize) -> String {
        self.edition.set_name(set)
    }

    /// The evaluation of a question on a training set, counted from 1.
    pub(crate) fn evaluation(&self, set: usize, question: StudyQuestion) -> Option<&Evaluation> {
        self.evaluations
            .iter()
            .find(|evaluation| evaluation.plan.set == set && evaluation.plan.question == question)
    }

    /// The name of a predictor in the study: a model, or a baseline.
    pub(crate) fn name_of<'a>(&'a self, predictor: &'a PredictorInfo) -> &'a str {
        let training = predictor.digest.and_then(|digest| {
            self.trainings.iter().find(|training| training.record.digest == digest)
        });
        training.map_or(&predictor.name, |training| &training.plan.model)
    }

    /// The name of a predictor that the report of `evaluation` mentions.
    pub(crate) fn called<'a>(&'a self, evaluation: &'a Evaluation, predictor: &'a str) -> &'a str {
        let info = evaluation.report.predictors.iter().find(|info| info.name == predictor);
        info.map_or(predictor, |info| self.name_of(info))
    }

    /// The models and baselines of an evaluation, in the order of every table, each once.
    pub(crate) fn names<'a>(&'a self, evaluation: &'a Evaluation) -> Vec<&'a str> {
        let mut names = Vec::new();
        for info in &evaluation.report.predictors {
            let name = self.name_of(info);
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }

    /// The scores of a model or a baseline over one of an evaluation's shifts.
    pub(crate) fn scores<'a>(
        &self,
        evaluation: &'a Evaluation,
        shift: &'a ShiftSummary,
        name: &str,
    ) -> Option<&'a ShiftScores> {
        shift.models.iter().find(|scores| {
            scores.predictors.iter().any(|predictor| self.called(evaluation, predictor) == name)
        })
    }
}

impl Evaluation {
    /// The errors under a shift: of one family, or of all families together if it is `None`.
    pub(crate) fn shift(&self, shift: Shift, family: Option<Family>) -> Option<&ShiftSummary> {
        let mut shifts = self.report.shifts.iter();
        shifts.find(|summary| summary.shift == shift && summary.family == family)
    }
}
