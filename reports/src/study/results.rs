//! What a study computed: what its report is made of.

use serde::Serialize;
use spec::{Digest, PipelineSpec};
use wire::{PredictorInfo, Report};

use super::plan::Scale;

/// The models that are compared, in the order of every table.
pub const MODELS: [&str; 6] =
    ["robomorph", "robomorph-gaussian", "diffuser", "cdcnn", "cdt", "flow"];
/// Those that remove noise, whose chains the warm start cuts short.
pub const DENOISERS: [&str; 3] = ["diffuser", "cdcnn", "cdt"];
/// The deterministic one, which the paper compares with.
pub const REFERENCE: &str = "robomorph";

/// What a study computed.
#[derive(Debug)]
pub struct Study {
    pub scale: Scale,
    /// Every job with all its defaults.
    pub spec: PipelineSpec,
    /// The pipeline's job.
    pub pipeline: JobRecord,
    /// One for each training set, D1 to D4.
    pub sets: Vec<Set>,
    pub warm_start: Evaluation,
}

/// One training set, and what was made of it.
#[derive(Debug)]
pub struct Set {
    /// As the paper calls it, e.g. `D1`.
    pub name: String,
    pub data: JobRecord,
    pub trajectories: u64,
    pub trainings: Vec<Training>,
    pub sweep: Evaluation,
    pub samples: Evaluation,
}

/// Where numbers come from.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JobRecord {
    /// In the pipeline.
    pub name: String,
    pub job: i64,
    /// Of its spec, and with it of everything it was made from.
    pub digest: Digest,
    /// From start to end, on the machine that computed it.
    pub seconds: Option<f64>,
    /// It was computed before this study asked for it.
    pub reused: bool,
}

#[derive(Debug)]
pub struct Training {
    pub model: String,
    pub record: JobRecord,
    pub checkpoint: i64,
    pub sha256: String,
    pub steps: u64,
    pub validation_rmse_deg: Option<f64>,
}

#[derive(Debug)]
pub struct Evaluation {
    pub record: JobRecord,
    pub report: Report,
    pub files: Vec<File>,
}

/// Something that an evaluation left.
#[derive(Debug)]
pub struct File {
    pub name: String,
    pub bytes: Vec<u8>,
}

impl Set {
    /// What a predictor of this set's evaluations is called in the study.
    pub fn name_of<'a>(&'a self, predictor: &'a PredictorInfo) -> &'a str {
        let training = predictor.digest.and_then(|digest| {
            self.trainings.iter().find(|training| training.record.digest == digest)
        });
        training.map_or(&predictor.name, |training| &training.model)
    }

    /// The predictor of a model in one of this set's evaluations.
    pub fn predictor<'a>(&self, report: &'a Report, model: &str) -> Option<&'a PredictorInfo> {
        report.predictors.iter().find(|predictor| self.name_of(predictor) == model)
    }
}
