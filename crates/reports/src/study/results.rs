//! The results of a study, from which its report is made.

use serde::Serialize;
use spec::{
    Digest, Family, PipelineSpec, StudyEvaluation, StudyQuestion, StudyScale, StudyTraining,
};
use wire::{PredictorInfo, Report, Shift, ShiftScores, ShiftSummary};

/// The results of a study.
#[derive(Debug)]
pub struct Study {
    pub scale: StudyScale,
    /// Every job, with all defaults filled in.
    pub spec: PipelineSpec,
    /// The pipeline's job.
    pub pipeline: JobRecord,
    pub trainings: Vec<Training>,
    pub evaluations: Vec<Evaluation>,
}

/// The record of a job that computed numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JobRecord {
    /// The job's name in the pipeline.
    pub name: String,
    pub job: i64,
    /// The digest of its spec, which covers everything that it was made from.
    pub digest: Digest,
    /// Seconds from start to end, on the machine that computed it.
    pub seconds: Option<f64>,
    /// Whether it was computed before this study was submitted.
    pub reused: bool,
}

#[derive(Debug)]
pub struct Training {
    pub plan: StudyTraining,
    pub record: JobRecord,
    pub checkpoint: i64,
    pub sha256: String,
    pub steps: u64,
    pub validation_rmse_deg: Option<f64>,
}

#[derive(Debug)]
pub struct Evaluation {
    pub plan: StudyEvaluation,
    pub record: JobRecord,
    pub report: Report,
    pub files: Vec<File>,
}

/// A file that an evaluation left.
#[derive(Debug)]
pub struct File {
    pub name: String,
    pub bytes: Vec<u8>,
}

impl Study {
    /// The number of training sets, beginning with D1.
    pub fn sets(&self) -> usize {
        self.evaluations.iter().map(|evaluation| evaluation.plan.set).max().unwrap_or(0)
    }

    pub fn evaluation(&self, set: usize, question: StudyQuestion) -> Option<&Evaluation> {
        self.evaluations
            .iter()
            .find(|evaluation| evaluation.plan.set == set && evaluation.plan.question == question)
    }

    /// The name of a predictor in the study: a model, or a baseline.
    pub fn name_of<'a>(&'a self, predictor: &'a PredictorInfo) -> &'a str {
        let training = predictor.digest.and_then(|digest| {
            self.trainings.iter().find(|training| training.record.digest == digest)
        });
        training.map_or(&predictor.name, |training| &training.plan.model)
    }

    /// The name of a predictor that the report of `evaluation` mentions.
    pub fn called<'a>(&'a self, evaluation: &'a Evaluation, predictor: &'a str) -> &'a str {
        let info = evaluation.report.predictors.iter().find(|info| info.name == predictor);
        info.map_or(predictor, |info| self.name_of(info))
    }

    /// The models and baselines of an evaluation, in the order of every table, each once.
    pub fn names<'a>(&'a self, evaluation: &'a Evaluation) -> Vec<&'a str> {
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
    pub fn scores<'a>(
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
    pub fn shift(&self, shift: Shift, family: Option<Family>) -> Option<&ShiftSummary> {
        let mut shifts = self.report.shifts.iter();
        shifts.find(|summary| summary.shift == shift && summary.family == family)
    }
}
