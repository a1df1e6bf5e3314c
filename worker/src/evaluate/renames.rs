//! Names that changed since a cell was evaluated.
//!
//! People may rename a training while an evaluation runs, and an evaluation that is tried again
//! takes over cells of the one before. The report has the names of its own moment.

use std::collections::HashMap;

use evaluation::CellResult;

use super::predictors::Predictors;

/// The names of the predictors, in the order of every table.
pub(super) struct PresentNames {
    predictors: Vec<String>,
    /// For those that are checkpoints: the checkpoint's name, with which each of its names begins.
    checkpoints: Vec<Option<String>>,
}

impl PresentNames {
    pub fn of(predictors: &Predictors<'_>) -> Self {
        let infos = predictors.infos();
        let others = infos.len() - predictors.learned.len();
        let learned =
            predictors.learned.iter().map(|predictor| Some(predictor.checkpoint.info.name.clone()));
        Self {
            predictors: infos.into_iter().map(|info| info.name).collect(),
            checkpoints: std::iter::repeat_n(None, others).chain(learned).collect(),
        }
    }

    /// Gives the predictors of a cell their present names. Returns the changes, by the name before.
    pub fn give_to(&self, cell: &mut CellResult) -> HashMap<String, String> {
        let mut changes = HashMap::new();
        if cell.predictors.len() != self.predictors.len() {
            return changes;
        }
        let present = self.predictors.iter().zip(&self.checkpoints);
        for (errors, (name, checkpoint)) in cell.predictors.iter_mut().zip(present) {
            if errors.predictor == *name {
                continue;
            }
            let before = std::mem::replace(&mut errors.predictor, name.clone());
            // Warnings name the checkpoint without its sampler.
            let sampler =
                checkpoint.as_ref().and_then(|checkpoint| name.strip_prefix(checkpoint.as_str()));
            if let (Some(checkpoint), Some(sampler)) = (checkpoint, sampler)
                && let Some(bare) = before.strip_suffix(sampler)
            {
                changes.insert(bare.to_owned(), checkpoint.clone());
            }
            changes.insert(before, name.clone());
        }
        for warning in &mut cell.warnings {
            if let Some(name) = warning.predictor.as_ref().and_then(|before| changes.get(before)) {
                warning.predictor = Some(name.clone());
            }
        }
        changes
    }
}

#[cfg(test)]
mod tests {
    use evaluation::PredictorErrors;
    use wire::Warning;

    use super::*;

    fn cell(names: &[&str], warned: &str) -> CellResult {
        let named = |name: &&str| PredictorErrors {
            predictor: (*name).to_owned(),
            ..PredictorErrors::default()
        };
        CellResult {
            cell: 0,
            family: None,
            frequency_hz: None,
            position_noise_rad: 0.0,
            first: 0,
            joints: 7,
            horizons_s: Vec::new(),
            predictors: names.iter().map(named).collect(),
            measured_jitter_deg: None,
            measured_left_limits: None,
            within_torque_limits: Vec::new(),
            warnings: vec![Warning::no_motion(1e-3, 1).of(warned)],
        }
    }

    #[test]
    fn a_cell_takes_the_names_of_the_report_with_its_warnings() {
        let present = PresentNames {
            predictors: ["arx", "b ddim 5", "a"].map(str::to_owned).to_vec(),
            checkpoints: vec![None, Some("b".to_owned()), Some("a".to_owned())],
        };
        // The two trainings exchanged their names.
        let mut found = cell(&["arx", "a ddim 5", "b"], "a");
        let changes = present.give_to(&mut found);
        let names: Vec<&str> =
            found.predictors.iter().map(|errors| errors.predictor.as_str()).collect();
        assert_eq!(names, ["arx", "b ddim 5", "a"]);
        assert_eq!(found.warnings[0].predictor.as_deref(), Some("b"));
        assert_eq!(changes["a ddim 5"], "b ddim 5");
        assert_eq!(changes["b"], "a");
        assert!(present.give_to(&mut found).is_empty());
    }
}
