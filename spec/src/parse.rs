//! From JSON to a spec that can be trusted.

use serde_json::{Map, Value};

use crate::check::{Check, Report};
use crate::{JobKind, JobSpec, SpecError, preset, stream};

/// Reads a spec: resolves `preset`, refuses unknown fields and checks every value.
///
/// # Errors
/// Names every field that cannot be accepted, its value and what is allowed.
pub fn parse(text: &[u8]) -> Result<JobSpec, SpecError> {
    let value: Value = serde_json::from_slice(text)
        .map_err(|error| SpecError::one("", "", format!("not valid JSON: {error}")))?;
    let spec = read(value)?;
    let mut report = Report::default();
    spec.check(&mut report);
    check_outside_pipeline(&spec, &mut report);
    report.finish()?;
    Ok(spec)
}

/// A job on its own has no siblings to refer to by name.
fn check_outside_pipeline(spec: &JobSpec, report: &mut Report) {
    for job in spec.named_jobs() {
        let allowed = format!("{}; {{\"job\": NAME}} only in a pipeline", job.product.names());
        report.violation(&job.field, format!("{{\"job\": {:?}}}", job.name), allowed);
    }
}

/// Deserializes one job, by `kind`, without checking its values.
pub(crate) fn read(value: Value) -> Result<JobSpec, SpecError> {
    let Value::Object(fields) = value else {
        return Err(SpecError::one("", shorten(&value), "a JSON object"));
    };
    let mut fields = preset::resolve_job(fields)?;
    let kind: JobKind = match fields.remove("kind") {
        Some(Value::String(kind)) => kind.parse()?,
        Some(other) => return Err(SpecError::one("kind", shorten(&other), JobKind::names())),
        None => return Err(SpecError::one("kind", "missing", JobKind::names())),
    };
    JobSpec::read(kind, stream::resolve(fields)?)
}

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
