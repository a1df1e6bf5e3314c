//! Predictions of a model that torqued does not know.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::spec::{Baseline, EvaluateSpec};
use crate::check::{Check, Violations, first_repeated};
use crate::{DataSource, DataSpec, ImportSpec, ModelSpec, Split};

/// Files of predictions in one evaluation, at most.
const MAX_FILES: usize = 20;

/// Bytes of a predictor's name, at most.
const MAX_NAME: usize = 60;

/// The answers of a model that torqued does not know. They were sent as a file and imported as a dataset: a
/// recording per scenario, with the torques of the horizon and the positions that the model predicts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FilePredictions {
    /// The predictor's name in tables and figures: 1 to 60 letters, digits, `.`, `_` and `-`.
    pub name: String,
    /// The imported dataset. A recording is named by its trajectory in the evaluation's data, `7`, or by trajectory
    /// and sample, `7/0`.
    pub data: DataSource,
}

impl Check for FilePredictions {
    fn check(&self, violations: &mut Violations) {
        let is_allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-');
        let name = format!("{:?}", self.name);
        if !(1..=MAX_NAME).contains(&self.name.len()) || !self.name.chars().all(is_allowed) {
            violations.add("name", name, "1 to 60 letters, digits, '.', '_' and '-'");
        } else if let Some(taken) = reserved(&self.name) {
            violations.add("name", name, format!("another name than that of a {taken}"));
        }
        if matches!(self.data, DataSource::Stream(_)) {
            violations.add("data", "a stream", "the dataset that an import of the file made");
        }
    }
}

/// The kind of predictor that has this name whether or not the evaluation asks it: a reader would take the one for
/// the other.
fn reserved(name: &str) -> Option<&'static str> {
    if Baseline::is_name(name) {
        return Some("baseline");
    }
    ModelSpec::ARCHITECTURES.contains(&name).then_some("model of torqued")
}

impl EvaluateSpec {
    /// Checks everything about files of predictions that needs nothing but this spec.
    pub(super) fn check_predictions(&self, violations: &mut Violations) {
        violations.length("predictions", self.predictions.len(), 0..=MAX_FILES);
        for (i, predictions) in self.predictions.iter().enumerate() {
            violations.part(&format!("predictions[{i}]"), predictions);
        }
        if self.predictions.is_empty() {
            return;
        }
        let names: Vec<&str> =
            self.predictions.iter().map(|prediction| prediction.name.as_str()).collect();
        if let Some(twice) = first_repeated(&names) {
            violations.add("predictions", format!("{twice:?} twice"), "each name once");
        }
        if matches!(self.data, DataSource::Stream(_)) {
            let allowed = "with predictions: a dataset, whose contexts the model was given";
            violations.add("data", "a stream", allowed);
        }
        if self.position_noise_rad != [0.0] {
            let value = format!("{:?}", self.position_noise_rad);
            let allowed = "[0.0] with predictions: a file answers the contexts of the dataset, not those with other \
                           noise";
            violations.add("position_noise_rad", value, allowed);
        }
    }

    /// Checks the imports that hold predictions, in the spec's order, for the horizon of `data`.
    pub(super) fn check_files(
        &self,
        data: &DataSpec,
        horizon: Option<u32>,
        files: &[&DataSpec],
        violations: &mut Violations,
    ) {
        for (i, file) in files.iter().enumerate() {
            let field = format!("predictions[{i}].data");
            let DataSpec::Import(import) = file else {
                let allowed = "an import of a file of predictions";
                violations.add(&field, "a simulation", allowed);
                continue;
            };
            check_import(&field, import, violations);
            let mut same = |what: &str, found: f64, asked: f64| {
                if (found - asked).abs() > f64::EPSILON {
                    let allowed = format!("{what} {asked}, as this evaluation has");
                    violations.add(&field, format!("an import with {what} {found}"), allowed);
                }
            };
            same("joints", file.joints() as f64, data.joints() as f64);
            same("rate_hz", file.rate_hz(), data.rate_hz());
            if let Some(horizon) = horizon {
                same("samples", f64::from(file.samples()), f64::from(horizon));
            }
        }
    }
}

/// Whether each trajectory of an import has a name of its own.
fn check_import(field: &str, import: &ImportSpec, violations: &mut Violations) {
    if !import.files.is_empty() {
        violations.add(field, format!("an import of {} files", import.files.len()), "of one file");
    }
    if import.columns.recording.is_none() {
        let allowed = "a column that names the trajectory, or trajectory and sample, of each row";
        violations.add(field, "an import without columns.recording", allowed);
    }
    if import.split != Split::Whole {
        let allowed = "split \"whole\": a recording is one prediction";
        violations.add(field, "an import with split \"windows\"", allowed);
    }
}
