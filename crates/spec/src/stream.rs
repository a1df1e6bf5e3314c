//! `{"stream": SPEC}` in a job's `data`: a simulation that is never stored.

use serde_json::{Map, Value};

use crate::check::{Check, Violations};
use crate::preset::{self, presets_of_kind, text_for_object};
use crate::schema::Components;
use crate::shorten::shorten;
use crate::{DataSource, JobKind, MAX_TRAJECTORIES, SpecError, Violation, simulate};

/// Resolves the presets of streams, and accepts the `kind` that a copied job may have.
pub(crate) fn resolve(
    mut fields: Map<String, Value>,
    found: &mut SpecError,
    schemas: &Components,
) -> Map<String, Value> {
    for (field, source) in sources(&mut fields) {
        if let Some(stream) = stream_of(source)
            && let Err(error) = resolve_fields(stream, schemas)
        {
            found.append(error.within(&format!("{field}.stream")));
        }
        if let Some(violation) = name_for_stream(&field, source) {
            found.add_with(|| violation);
        }
    }
    fields
}

/// The violation of a text in place of a stream, or of its preset's name in place of a source.
fn name_for_stream(field: &str, source: &Value) -> Option<Violation> {
    let simulations = presets_of_kind(JobKind::Simulate);
    if let Some(name) = source.get("stream").and_then(Value::as_str) {
        return Some(text_for_object(&format!("{field}.stream"), name, &simulations));
    }
    let name = source.as_str()?;
    let preset = simulations.iter().find(|preset| preset.name == name)?;
    let allowed =
        format!("an object; did you mean {{\"stream\": {{\"preset\": \"{}\"}}}}?", preset.name);
    Some(Violation::new(field, shorten(source), allowed))
}

/// Makes the streams of a training endless, because it need not say how many robots they have.
pub(crate) fn make_endless(fields: &mut Map<String, Value>) {
    for stream in sources(fields).into_iter().filter_map(|(_, source)| stream_of(source)) {
        stream.entry("trajectories").or_insert_with(|| MAX_TRAJECTORIES.into());
    }
}

/// The source of a job's `data`, or each of a list, with its path.
fn sources(fields: &mut Map<String, Value>) -> Vec<(String, &mut Value)> {
    match fields.get_mut("data") {
        Some(Value::Array(list)) => {
            let path = |(i, source)| (format!("data[{i}]"), source);
            list.iter_mut().enumerate().map(path).collect()
        }
        Some(source) => vec![("data".to_owned(), source)],
        None => Vec::new(),
    }
}

fn stream_of(source: &mut Value) -> Option<&mut Map<String, Value>> {
    source.get_mut("stream")?.as_object_mut()
}

fn resolve_fields(stream: &mut Map<String, Value>, schemas: &Components) -> Result<(), SpecError> {
    *stream = preset::resolve_job(std::mem::take(stream))?;
    match stream.remove("kind") {
        None => simulate::complete(stream, schemas),
        Some(kind) if kind == "simulate" => simulate::complete(stream, schemas),
        Some(other) => Err(SpecError::one("kind", shorten(&other), "simulate")),
    }
}

impl Check for DataSource {
    fn check(&self, violations: &mut Violations) {
        let Self::Stream(stream) = self else { return };
        violations.part("stream", stream.as_ref());
        if !stream.execution.is_default() {
            violations.add(
                "stream.execution",
                "given",
                "left out: a stream is not a job of its own",
            );
        }
    }
}
