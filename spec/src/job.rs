use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::check::{Check, Report};
use crate::{
    CheckpointRef, ControlSpec, DataSource, Digest, EvaluateSpec, Execution, ImportSpec,
    PipelineSpec, SimulateSpec, SpecError, TrainSpec, VerifySpec, evaluate, preset, stream,
};

/// Anything a user can ask for.
#[expect(clippy::large_enum_variant, reason = "a handful exist at a time")]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum JobSpec {
    Simulate(SimulateSpec),
    Train(TrainSpec),
    Evaluate(EvaluateSpec),
    Control(ControlSpec),
    Import(ImportSpec),
    Verify(VerifySpec),
    Pipeline(PipelineSpec),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum JobKind {
    Simulate,
    Train,
    Evaluate,
    Control,
    Import,
    Verify,
    Pipeline,
}

impl JobKind {
    pub const ALL: [Self; 7] = [
        Self::Simulate,
        Self::Train,
        Self::Evaluate,
        Self::Control,
        Self::Import,
        Self::Verify,
        Self::Pipeline,
    ];

    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Simulate => "simulate",
            Self::Train => "train",
            Self::Evaluate => "evaluate",
            Self::Control => "control",
            Self::Import => "import",
            Self::Verify => "verify",
            Self::Pipeline => "pipeline",
        }
    }
}

impl fmt::Display for JobKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Reads a spec: resolves `preset`, refuses unknown fields and checks every value.
///
/// # Errors
/// Names every field that cannot be accepted, its value and what is allowed.
pub fn parse(text: &[u8]) -> Result<JobSpec, SpecError> {
    let value: Value = serde_json::from_slice(text)
        .map_err(|error| SpecError::one("", "", format!("not valid JSON: {error}")))?;
    parse_value(value)
}

fn parse_value(value: Value) -> Result<JobSpec, SpecError> {
    let spec = read(value)?;
    let mut report = Report::default();
    spec.check(&mut report);
    check_outside_pipeline(&spec, &mut report);
    report.finish()?;
    Ok(spec)
}

/// A job on its own has no siblings to refer to by name.
fn check_outside_pipeline(spec: &JobSpec, report: &mut Report) {
    let (data, checkpoints) = match spec {
        JobSpec::Train(spec) => (Some(&spec.data), &[][..]),
        JobSpec::Evaluate(spec) => (Some(&spec.data), &spec.checkpoints[..]),
        JobSpec::Control(spec) => (Some(&spec.data), &spec.checkpoints[..]),
        JobSpec::Verify(spec) => (Some(&spec.data), &[][..]),
        JobSpec::Simulate(_) | JobSpec::Import(_) | JobSpec::Pipeline(_) => (None, &[][..]),
    };
    if let Some(DataSource::Job(name)) = data {
        let allowed = r#"{"dataset": ID} or {"digest": HEX}; {"job": NAME} only in a pipeline"#;
        report.violation("data", format!("{{\"job\": {name:?}}}"), allowed);
    }
    for (i, checkpoint) in checkpoints.iter().enumerate() {
        if let Some(name) = checkpoint.job() {
            let allowed = r#"{"checkpoint": ID}, {"digest": HEX} or {"best": {"digest": HEX}}; {"job": NAME} only in a pipeline"#;
            report.violation(
                &format!("checkpoints[{i}]"),
                format!("{{\"job\": {name:?}}}"),
                allowed,
            );
        }
    }
}

/// Deserializes one job, by `kind`, without checking its values.
fn read(value: Value) -> Result<JobSpec, SpecError> {
    let Value::Object(fields) = value else {
        return Err(SpecError::one("", shorten(&value), "a JSON object"));
    };
    let mut fields = preset::resolve_job(fields)?;
    let kinds = JobKind::ALL.map(JobKind::as_str).join(", ");
    let kind = match fields.remove("kind") {
        Some(Value::String(kind)) => kind,
        Some(other) => return Err(SpecError::one("kind", shorten(&other), kinds)),
        None => return Err(SpecError::one("kind", "missing", kinds)),
    };
    match kind.as_str() {
        "simulate" => Ok(JobSpec::Simulate(from_fields(fields)?)),
        "train" => {
            let fields = preset::resolve_model(stream::resolve_endless(fields)?)?;
            Ok(JobSpec::Train(from_fields(fields)?))
        }
        "evaluate" => Ok(JobSpec::Evaluate(evaluate::read(fields)?)),
        "control" => Ok(JobSpec::Control(from_fields(stream::resolve(fields)?)?)),
        "import" => Ok(JobSpec::Import(from_fields(fields)?)),
        "verify" => Ok(JobSpec::Verify(from_fields(stream::resolve(fields)?)?)),
        "pipeline" => read_pipeline(fields),
        other => Err(SpecError::one("kind", format!("{other:?}"), kinds)),
    }
}

/// Reads the members one by one, so that an error names its path and presets work inside.
fn read_pipeline(mut fields: Map<String, Value>) -> Result<JobSpec, SpecError> {
    use crate::PipelineMember;
    let members = match fields.insert("jobs".to_owned(), Value::Object(Map::new())) {
        Some(Value::Object(members)) => members,
        Some(other) => {
            return Err(SpecError::one("jobs", shorten(&other), "an object of named jobs"));
        }
        None => return Err(SpecError::one("jobs", "missing", "an object of named jobs")),
    };
    let mut pipeline: PipelineSpec = from_fields(fields)?;
    for (name, member) in members {
        let path = format!("jobs.{name}");
        let Value::Object(mut member) = member else {
            return Err(SpecError::one(path, shorten(&member), "a JSON object"));
        };
        let needs = match member.remove("needs") {
            Some(needs) => serde_json::from_value(needs)
                .map_err(|error| SpecError::one(format!("{path}.needs"), "", error.to_string()))?,
            None => Vec::new(),
        };
        let spec = read(Value::Object(member)).map_err(|error| error.within(&path))?;
        pipeline.jobs.insert(name, PipelineMember { needs, spec });
    }
    Ok(JobSpec::Pipeline(pipeline))
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

impl Check for JobSpec {
    fn check(&self, report: &mut Report) {
        match self {
            Self::Simulate(spec) => spec.check(report),
            Self::Train(spec) => spec.check(report),
            Self::Evaluate(spec) => spec.check(report),
            Self::Control(spec) => spec.check(report),
            Self::Import(spec) => spec.check(report),
            Self::Verify(spec) => spec.check(report),
            Self::Pipeline(spec) => spec.check(report),
        }
    }
}

impl JobSpec {
    pub const fn kind(&self) -> JobKind {
        match self {
            Self::Simulate(_) => JobKind::Simulate,
            Self::Train(_) => JobKind::Train,
            Self::Evaluate(_) => JobKind::Evaluate,
            Self::Control(_) => JobKind::Control,
            Self::Import(_) => JobKind::Import,
            Self::Verify(_) => JobKind::Verify,
            Self::Pipeline(_) => JobKind::Pipeline,
        }
    }

    /// How to run it; a pipeline's members have their own.
    pub fn execution(&self) -> Execution {
        match self {
            Self::Simulate(spec) => spec.execution,
            Self::Train(spec) => spec.execution,
            Self::Evaluate(spec) => spec.execution,
            Self::Control(spec) => spec.execution,
            Self::Import(spec) => spec.execution,
            Self::Verify(spec) => spec.execution,
            Self::Pipeline(_) => Execution::default(),
        }
    }

    /// The spec as JSON with every default filled in.
    pub fn to_json(&self) -> Value {
        // The types hold finite numbers and string keys only, so this cannot fail.
        serde_json::to_value(self).expect("a spec serializes to JSON")
    }

    /// What names the results of this spec; see the crate's documentation.
    ///
    /// Covers everything upstream once the references are digests, and nothing of `execution`.
    pub fn digest(&self) -> Digest {
        let mut json = self.to_json();
        remove_execution(&mut json);
        Digest::of_json(&json)
    }

    /// The dataset this job reads.
    pub fn dataset_ref(&mut self) -> Option<&mut DataSource> {
        match self {
            Self::Train(spec) => Some(&mut spec.data),
            Self::Evaluate(spec) => Some(&mut spec.data),
            Self::Control(spec) => Some(&mut spec.data),
            Self::Verify(spec) => Some(&mut spec.data),
            Self::Simulate(_) | Self::Import(_) | Self::Pipeline(_) => None,
        }
    }

    /// The checkpoints this job reads.
    pub fn checkpoint_refs(&mut self) -> &mut [CheckpointRef] {
        match self {
            Self::Evaluate(spec) => &mut spec.checkpoints,
            Self::Control(spec) => &mut spec.checkpoints,
            Self::Simulate(_)
            | Self::Train(_)
            | Self::Import(_)
            | Self::Verify(_)
            | Self::Pipeline(_) => &mut [],
        }
    }
}

fn remove_execution(json: &mut Value) {
    let Value::Object(fields) = json else { return };
    fields.remove("execution");
    if let Some(Value::Object(members)) = fields.get_mut("jobs") {
        members.values_mut().for_each(remove_execution);
    }
}
