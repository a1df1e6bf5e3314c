//! An import as a kind of job.

use serde_json::{Map, Value};

use super::spec::{ImportSpec, LowPassHz, defaults};
use crate::kind::{KindSpec, from_fields};
use crate::schema::Components;
use crate::simulate::complete_robot;
use crate::{DataSpec, Execution, Product, Reference, Referred, SpecError};

impl KindSpec for ImportSpec {
    fn read(
        mut fields: Map<String, Value>,
        mut found: SpecError,
        schemas: &Components,
    ) -> Result<Self, SpecError> {
        if let Err(error) = complete_robot(&mut fields, schemas) {
            found.append(error);
        }
        if fields.get("robot").is_some_and(|robot| !robot.is_null()) {
            leave_ranges_to_robot(&mut fields);
        }
        state_low_pass(&mut fields);
        from_fields(fields, found, schemas)
    }

    fn makes() -> Option<Product> {
        Some(Product::Trajectories)
    }

    fn execution(&self) -> Execution {
        self.execution.clone()
    }

    fn references(&mut self) -> Vec<Reference<'_>> {
        let one = self.file.iter_mut();
        let one = one.map(|file| Reference { field: "file".to_owned(), to: Referred::File(file) });
        let named = self.files.iter_mut().enumerate().map(|(i, named)| Reference {
            field: format!("files[{i}].file"),
            to: Referred::File(&mut named.file),
        });
        one.chain(named).collect()
    }

    fn data(&self) -> Option<DataSpec> {
        Some(DataSpec::Import(self.clone()))
    }
}

/// Leaves the limits to the named robot where `ranges` gives none.
fn leave_ranges_to_robot(fields: &mut Map<String, Value>) {
    let ranges = fields.entry("ranges").or_insert_with(|| Map::new().into());
    let Value::Object(ranges) = ranges else { return };
    for quantity in ["u_nm", "q_rad", "qd_rad_s"] {
        ranges.entry(quantity).or_insert(Value::Null);
    }
}

/// States the default of `low_pass_hz`. It is no default of deserialization, because specs that were
/// stored without the field keep their meaning and their digest.
fn state_low_pass(fields: &mut Map<String, Value>) {
    let is_stated = fields.get("low_pass_hz").is_some_and(|edge| !edge.is_null());
    let makes_samples = ["linear", "mean"].map(Value::from);
    if is_stated || !fields.get("resampling").is_some_and(|given| makes_samples.contains(given)) {
        return;
    }
    let rate_hz = fields.get("rate_hz").map_or(Some(defaults::rate_hz()), Value::as_f64);
    if let Some(rate_hz) = rate_hz {
        fields.insert("low_pass_hz".to_owned(), (LowPassHz::DEFAULT_SHARE * rate_hz).into());
    }
}
