//! An import as a kind of job.

use serde_json::{Map, Value};

use super::spec::ImportSpec;
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
        from_fields(fields, found, schemas)
    }

    fn makes() -> Option<Product> {
        Some(Product::Trajectories)
    }

    fn execution(&self) -> Execution {
        self.execution.clone()
    }

    fn references(&mut self) -> Vec<Reference<'_>> {
        vec![Reference { field: "file".to_owned(), to: Referred::File(&mut self.file) }]
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
