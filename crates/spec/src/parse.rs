//! Parses JSON into a spec that can be trusted.

use serde_json::Value;

use crate::check::{Check, Violations};
use crate::schema::RESOLVED;
use crate::{JobSpec, SpecError, read_json};

/// Reads a spec: resolves `preset`, refuses unknown fields and checks every value.
///
/// # Errors
/// Every refused field, with its value and what is allowed.
pub fn parse(text: &[u8]) -> Result<JobSpec, SpecError> {
    let value: Value = read_json(text)
        .map_err(|fault| SpecError::one("", "", format!("not valid JSON: {fault}")))?;
    parse_json(value)
}

/// Like [`parse`], from JSON that was read.
///
/// # Errors
/// When the spec is refused.
pub fn parse_json(value: Value) -> Result<JobSpec, SpecError> {
    let spec = JobSpec::from_json(value, &RESOLVED)?;
    let mut violations = Violations::default();
    spec.check(&mut violations);
    check_outside_pipeline(&spec, &mut violations);
    violations.finish()?;
    Ok(spec)
}

/// Refuses references by name, because a job on its own has no siblings.
fn check_outside_pipeline(spec: &JobSpec, violations: &mut Violations) {
    for job in spec.named_jobs() {
        let allowed = format!("{}; {{\"job\": NAME}} only in a pipeline", job.product.names());
        violations.add(&job.field, format!("{{\"job\": {:?}}}", job.name), allowed);
    }
}
