//! The fields of a JSON object, before they are a spec.

use serde_json::{Map, Value};

use crate::SpecError;

/// Deserializes `fields`; an error names the path of the field.
pub(crate) fn from_fields<T: serde::de::DeserializeOwned>(
    fields: Map<String, Value>,
) -> Result<T, SpecError> {
    let fields = Value::Object(fields);
    serde_path_to_error::deserialize(&fields).map_err(|error| {
        let path = error.path().to_string();
        let path = if path == "." { String::new() } else { path };
        SpecError::one(path, "", error.into_inner().to_string())
    })
}

/// A value as it appears in an error: whole when short.
pub(crate) fn shorten(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= 60 {
        return text;
    }
    text.chars().take(57).chain("...".chars()).collect()
}
