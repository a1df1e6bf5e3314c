//! The trait that the spec of every kind of job implements.

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::check::Check;
use crate::fields::from_fields;
use crate::{DataSpec, Doubt, Execution, Product, Reference, SpecError, Violation};

/// The fields of one kind of job.
pub(crate) trait KindSpec: Check {
    /// Deserializes them, without checking values. Presets and streams are resolved before, with what was `found` wrong
    /// with them.
    fn read(fields: Map<String, Value>, found: Vec<Violation>) -> Result<Self, SpecError>
    where
        Self: Sized + DeserializeOwned + ToSchema,
    {
        from_fields(fields, found)
    }

    /// The product of a job of this kind, which others may refer to.
    fn makes() -> Option<Product>
    where
        Self: Sized,
    {
        None
    }

    fn execution(&self) -> Execution;

    /// Everything that names the work of others, in the order in which it is looked up.
    fn references(&mut self) -> Vec<Reference<'_>> {
        Vec::new()
    }

    /// Puts what was left out, and depends on the robot, as the `data` that its references led to asks for.
    fn fit_to_data(&mut self, _data: &DataSpec) {}

    /// The trajectories that it makes, if it makes any.
    fn data(&self) -> Option<DataSpec> {
        None
    }

    /// Values that are allowed and yet probably not intended.
    fn doubts(&self) -> Vec<Doubt> {
        Vec::new()
    }
}
