//! Parses JSON into a spec that can be trusted.

use serde_json::Value;

use crate::check::{Check, Violations};
use crate::robot::refuse_named_robots;
use crate::schema::RESOLVED;
use crate::{JobSpec, SpecError, read_json};

/// Reads a spec: resolves `preset`, refuses unknown fields and checks every value.
///
/// # Errors
/// Every refused field, with its value and what is allowed.
///
/// ```
/// use spec::{JobKind, JobSpec, parse};
///
/// let job = parse(br#"{"kind": "simulate", "preset": "D1-chirp", "trajectories": 8}"#)?;
/// assert_eq!(job.kind(), JobKind::Simulate);
/// let JobSpec::Simulate(simulation) = &job else { unreachable!() };
/// assert_eq!((simulation.trajectories, simulation.rate_hz), (8, 60.0));
///
/// // The results of a job are those of its digest, whoever runs it and whenever.
/// let tomorrow = br#"{"preset": "D1-chirp", "trajectories": 8, "execution": {"priority": 5}}"#;
/// assert_eq!(parse(tomorrow)?.digest(), job.digest());
///
/// let error = parse(br#"{"preset": "D1-chirp", "trajectories": 8, "rate_hz": -60}"#).unwrap_err();
/// assert_eq!(error.violations[0].field, "rate_hz");
/// # Ok::<(), spec::SpecError>(())
/// ```
pub fn parse(text: &[u8]) -> Result<JobSpec, SpecError> {
    let value: Value = read_json(text)
        .map_err(|fault| SpecError::one("", "", format!("not valid JSON: {fault}")))?;
    parse_json(value)
}

/// Like [`parse`], from JSON that was read. A server has put descriptions in the place of the robots
/// that it keeps ([`crate::named_robots`]).
///
/// # Errors
/// When the spec is refused.
pub fn parse_json(mut value: Value) -> Result<JobSpec, SpecError> {
    refuse_named_robots(&mut value)?;
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
