//! JSON Schemas of specs: of resolved specs, after presets were merged, and of submitted specs.
//!
//! Shapes come from the types, and the bounds of numbers from the checks: see [`bounds`]. Errors
//! about shapes come from the same schemas ([`explain`]), so the document and the server cannot
//! differ.

mod bounds;
mod explain;
mod nearest;
mod nested;
mod resolved;
mod submitted;
mod words;

use std::sync::LazyLock;

use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::SpecError;

pub(crate) use explain::explain;
pub(crate) use nearest::listed;
pub use nearest::nearest;
pub(crate) use words::Components;

/// The schemas of specs without presets, for [`explain`].
pub(crate) static RESOLVED: LazyLock<Components> = LazyLock::new(resolved::components);

/// The schemas of all specs by name, for `components.schemas` of an OpenAPI 3.1 document.
/// `SubmittedJob` is a job as submitted, and `JobSpec` is a job with its kind.
pub fn schemas() -> Map<String, Value> {
    submitted::components(&RESOLVED)
}

/// Everything that is wrong with the shape of a value that should be a `T`.
pub fn shape_violations<T: ToSchema>(value: &Value) -> SpecError {
    let name = T::name().into_owned();
    let mut schemas = vec![(name.clone(), T::schema())];
    T::schemas(&mut schemas);
    explain(&resolved::strict(schemas), &name, value, &SpecError::default()).error
}
