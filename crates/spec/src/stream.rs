//! `{"stream": SPEC}` in a job's `data`: a simulation that is never stored.

use serde_json::{Map, Value};

use crate::check::{Check, Violations};
use crate::preset::{self, presets_of_kind, text_for_object};
use crate::schema::Components;
use crate::shorten::shorten;
use crate::{DataSource, JobKind, MAX_TRAJECTORIES, SpecError, Violation, simulate};

/// Resolves the preset of a stream, and accepts the `kind` that a copied job may have.
pub(crate) fn resolve(
    mut fields: Map<String, Value>,
    found: &mut SpecError,
    schemas: &Components,
) -> Map<String, Value> {
    if let Some(stream) = stream_of(&mut fields)
        && let Err(error) = resolve_fields(stream, schemas)
    {
        found.append(error.within("data.stream"));
    }
    if let Some(violation) = name_for_stream(&fields) {
        found.add_with(|| violation);
    }
    fields
}

/// The violation of a text in place of a stream, or of its preset's name in place of `data`.
fn name_for_stream(fields: &Map<String, Value>) -> Option<Violation> {
    let data = fields.get("data")?;
    let simulations = presets_of_kind(JobKind::Simulate);
    if let Some(name) = data.get("stream").and_then(Value::as_str) {
        return Some(text_for_object("data.stream", name, &simulations));
    }
    let name = data.as_str()?;
    let preset = simulations.iter().find(|preset| preset.name == name)?;
    let allowed =
        format!("an object; did you mean {{\"stream\": {{\"preset\": \"{}\"}}}}?", preset.name);
    Some(Violation::new("data", shorten(data), allowed))
}

/// Makes the stream of a training endless, because it need not say how many robots it has.
pub(crate) fn make_endless(fields: &mut Map<String, Value>) {
    if let Some(stream) = stream_of(fields) {
        stream.entry("trajectories").or_insert_with(|| MAX_TRAJECTORIES.into());
    }
}

fn stream_of(fields: &mut Map<String, Value>) -> Option<&mut Map<String, Value>> {
    fields.get_mut("data")?.get_mut("stream")?.as_object_mut()
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
