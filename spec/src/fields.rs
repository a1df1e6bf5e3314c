//! The fields of a JSON object, before they become a spec.

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::schema::explain;
use crate::{SpecError, Violation};

/// Deserializes `fields`. An error names everything that is wrong with their shape, in addition to
/// the violations `found` before.
pub(crate) fn from_fields<T: DeserializeOwned + ToSchema>(
    fields: Map<String, Value>,
    mut found: Vec<Violation>,
) -> Result<T, SpecError> {
    let fields = Value::Object(fields);
    let explained = explain(&T::name(), &fields);
    if explained.is_misshapen || !found.is_empty() {
        let known: Vec<String> = found.iter().map(|violation| violation.field.clone()).collect();
        let is_new =
            |violation: &Violation| !known.iter().any(|field| covers(field, &violation.field));
        found.extend(explained.violations.into_iter().filter(is_new));
        return Err(SpecError { violations: found });
    }
    serde_path_to_error::deserialize(&fields).map_err(|error| {
        if !explained.violations.is_empty() {
            return SpecError { violations: explained.violations };
        }
        let path = error.path().to_string();
        let path = if path == "." { String::new() } else { path };
        SpecError::one(path, "", error.into_inner().to_string())
    })
}

/// Whether a violation at `found` explains one at `field`, which lies inside or beside it.
fn covers(found: &str, field: &str) -> bool {
    let parent = found.rsplit_once('.').map_or(found, |(parent, _)| parent);
    field.strip_prefix(parent).is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
}

/// A value as text for an error; cut if it is long.
pub(crate) fn shorten(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= 60 {
        return text;
    }
    text.chars().take(57).chain("...".chars()).collect()
}
