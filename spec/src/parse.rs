//! Parses JSON into a spec that can be trusted.

use serde_json::Value;

use crate::check::{Check, Report};
use crate::{JobSpec, SpecError, read_json};

/// Reads a spec: resolves `preset`, refuses unknown fields and checks every value.
///
/// # Errors
/// Every refused field, with its value and what is allowed.
pub fn parse(text: &[u8]) -> Result<JobSpec, SpecError> {
    let value: Value = read_json(text)
        .map_err(|fault| SpecError::one("", "", format!("not valid JSON: {fault}")))?;
    let spec = JobSpec::from_json(value)?;
    let mut report = Report::default();
    spec.check(&mut report);
    check_outside_pipeline(&spec, &mut report);
    report.finish()?;
    Ok(spec)
}

/// Refuses references by name, because a job on its own has no siblings.
fn check_outside_pipeline(spec: &JobSpec, report: &mut Report) {
    for job in spec.named_jobs() {
        let allowed = format!("{}; {{\"job\": NAME}} only in a pipeline", job.product.names());
        report.violation(&job.field, format!("{{\"job\": {:?}}}", job.name), allowed);
    }
}
