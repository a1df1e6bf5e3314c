//! An evaluation as a kind of job.

use std::iter;

use serde_json::{Map, Value};

use super::default_grid;
use super::spec::EvaluateSpec;
use crate::kind::KindSpec;
use crate::schema::Components;
use crate::{Doubt, Execution, Reference, Referred, SpecError};

impl KindSpec for EvaluateSpec {
    fn read(
        fields: Map<String, Value>,
        found: SpecError,
        schemas: &Components,
    ) -> Result<Self, SpecError> {
        default_grid::read(fields, found, schemas)
    }

    fn execution(&self) -> Execution {
        self.execution.clone()
    }

    fn references(&mut self) -> Vec<Reference<'_>> {
        let checkpoints = Reference::checkpoints(&mut self.checkpoints);
        let predictions =
            self.predictions.iter_mut().enumerate().map(|(i, prediction)| Reference {
                field: format!("predictions[{i}].data"),
                to: Referred::Data(&mut prediction.data),
            });
        iter::once(Reference::data(&mut self.data)).chain(predictions).chain(checkpoints).collect()
    }

    fn doubts(&self) -> Vec<Doubt> {
        self.data.doubts("data")
    }
}
