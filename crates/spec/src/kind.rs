//! The trait that the spec of every kind of job implements.

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::check::Check;
use crate::fields::from_fields;
use crate::{DataSpec, Doubt, Execution, Product, Reference, SpecError};

/// The fields of one kind of job.
pub(crate) trait KindSpec: Check {
    /// Deserializes the fields, without checking values. Presets and streams are resolved before;
    /// `found` has their violations.
    fn read(fields: Map<String, Value>, found: SpecError) -> Result<Self, SpecError>
    where
        Self: Sized + DeserializeOwned + ToSchema,
    {
        from_fields(fields, found)
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
