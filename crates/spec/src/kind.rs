//! The trait that the spec of every kind of job implements.

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::check::Check;
use crate::schema::{Components, explain};
use crate::{DataSpec, Doubt, Execution, Product, Reference, SpecError};

/// The fields of one kind of job.
pub(crate) trait KindSpec: Check {
    /// Deserializes the fields, without checking values. Presets and streams are resolved before;
    /// `found` has their violations.
    /// `schemas` has the schemas of resolved specs.
    fn read(
        fields: Map<String, Value>,
        found: SpecError,
        schemas: &Components,
    ) -> Result<Self, SpecError>
    where
        Self: Sized + DeserializeOwned + ToSchema,
    {
        from_fields(fields, found, schemas)
    }

    /// The product of jobs of this kind, which other jobs may refer to.
    fn makes() -> Option<Product>
    where
        Self: Sized,
    {
        None
    }

    fn execution(&self) -> Execution;

    /// All references to other work, in the order in which they are resolved.
    fn references(&mut self) -> Vec<Reference<'_>> {
        Vec::new()
    }

    /// Sets defaults that depend on the robot, according to the `data` that the references were
    /// resolved to.
    fn fit_to_data(&mut self, _data: &DataSpec) {}

    /// The trajectories that the job makes, if it makes any.
    fn data(&self) -> Option<DataSpec> {
        None
    }

    /// Warnings about values that are allowed but probably not intended.
    fn doubts(&self) -> Vec<Doubt> {
        Vec::new()
    }
}

/// Deserializes `fields`. An error names everything that is wrong with their shape, in addition to
/// the violations `found` before.
pub(crate) fn from_fields<T: DeserializeOwned + ToSchema>(
    fields: Map<String, Value>,
    mut found: SpecError,
    schemas: &Components,
) -> Result<T, SpecError> {
    if found.is_full() {
        return Err(found);
    }
    let fields = Value::Object(fields);
    let explained = explain(schemas, &T::name(), &fields, &found);
    if explained.is_misshapen || !found.is_empty() {
        found.append(explained.error);
        return Err(found);
    }
    serde_path_to_error::deserialize(&fields).map_err(|error| {
        if !explained.error.is_empty() {
            return explained.error;
        }
        let path = error.path().to_string();
        let path = if path == "." { String::new() } else { path };
        SpecError::one(path, "", error.into_inner().to_string())
    })
}
