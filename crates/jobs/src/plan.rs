//! Plans a job: turns a spec with resolved references into a job with tasks.

use spec::{Execution, SpecError};
use store::NewJob;

use crate::kind::{Limits, kind};
use crate::references::Resolved;

/// Plans a resolved spec. `name` is its name in a pipeline.
///
/// # Errors
/// When it does not fit its inputs, or needs more tasks than a job may have.
pub(crate) fn plan(
    name: Option<&str>,
    resolved: &Resolved,
    limits: &Limits,
) -> Result<NewJob, SpecError> {
    let Resolved { spec, inputs } = resolved;
    let kind = kind(spec)
        .ok_or_else(|| SpecError::one("kind", spec.kind().as_str(), "any other kind of job"))?;
    kind.check_inputs(inputs)?;
    let digest = spec.digest();
    let asked = spec.execution();
    let time_limit_s = asked.time_limit_s.or(limits.time_limits_s.get(&spec.kind()).copied());
    let name = name.map(str::to_owned).or_else(|| kind.name(inputs));
    Ok(NewJob {
        name: name.unwrap_or_else(|| format!("{}-{}", spec.kind(), digest.short())),
        kind: spec.kind().to_string(),
        spec: spec.to_json(),
        digest,
        unit: kind.unit().to_owned(),
        execution: Execution { time_limit_s, ..asked },
        output: kind.output(),
        reuse: kind.reuse(),
        tasks: kind.tasks(inputs)?,
        needs: kind.needs(inputs),
        reads: inputs.reads.clone(),
        checkpoints: inputs.existing.clone(),
        files: inputs.files.clone(),
    })
}
