//! Completes the OpenAPI document with parts that handlers do not declare.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use utoipa::openapi;
use wire::Problem;

use super::{names, problems};
use crate::limits::{LOG_WAIT_SECONDS, LOGS_MAXIMUM, PAGE_MAXIMUM, POINTS_MAXIMUM};

#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "torqued",
        description = "In-context identification of robot dynamics as a service: simulate, train, \
                       evaluate.\n\nErrors are RFC 9457 problem details. Lists are newest first \
                       unless they are sorted; `next` is the `cursor` of the following page, and \
                       `null` on the last one. In attempts and the audit log, `next` is the `before`. \
                       Tasks are in the order in which they run, and `next` is the `after`; so it is \
                       in logs, where every page has it. Downloads answer HEAD, Range, If-Range and \
                       If-None-Match, and have the SHA-256 of the whole file as ETag and \
                       Repr-Digest. The bytes are compared with it: a download of a damaged file \
                       breaks off before its last bytes, and later requests get a problem of type \
                       `damaged`.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    security((), ("token" = ["read"])),
    // The schemas of a pipeline's member and of a job refer to each other, which the derive does
    // not follow. The report of a control job is an artifact, and a stream uses WebSocket. The data
    // of events is inside text messages.
    components(schemas(
        Problem, spec::PipelineMember, wire::ControlReport, wire::IdentificationReport, wire::StreamMessage, wire::StreamReply,
        wire::Event,
    )),
    modifiers(&TokenScheme),
)]
pub struct Document;

/// The token, declared once for all operations.
struct TokenScheme;

impl utoipa::Modify for TokenScheme {
    fn modify(&self, document: &mut openapi::OpenApi) {
        use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
        let scheme = HttpBuilder::new()
            .scheme(HttpAuthScheme::Bearer)
            .description(Some(
                "Required once the server has a token, from its start or created later. An operation lists the scope that it \
                 needs: `read`, `submit` or `admin`. Each scope includes those before it.",
            ))
            .build();
        document
            .components
            .get_or_insert_default()
            .add_security_scheme("token", SecurityScheme::Http(scheme));
    }
}

/// The document of the operations in `operations`, with exact schemas of specs and with every bound
/// and error.
pub fn complete(operations: &openapi::OpenApi) -> Value {
    // It has only strings, numbers and lists, so this cannot fail.
    let mut document = serde_json::to_value(operations).expect("a document is JSON");
    for (path, item) in document["paths"].as_object_mut().into_iter().flatten() {
        for (method, operation) in item.as_object_mut().into_iter().flatten() {
            operation["operationId"] = names::of_operation(method, path).into();
            describe_answers(operation);
            problems::add(operation, method, path);
            bound_parameters(operation, path);
            declare_bytes(operation);
        }
    }
    let submitted = json!({"$ref": "#/components/schemas/SubmittedJob"});
    document["paths"]["/v1/jobs"]["post"]["requestBody"]["content"]["application/json"]["schema"] =
        submitted;
    add_specs(&mut document);
    document
}

/// Describes answers without a description by their status.
fn describe_answers(operation: &mut Value) {
    for (status, response) in operation["responses"].as_object_mut().into_iter().flatten() {
        if response["description"].as_str().is_none_or(str::is_empty) {
            response["description"] = match status.as_str() {
                "201" => "It is new",
                "202" => "It has begun",
                _ => "The answer",
            }
            .into();
        }
    }
}

/// Replaces the schemas of specs, and removes those that nothing refers to.
fn add_specs(document: &mut Value) {
    let mut specs = spec::schemas();
    let Some(schemas) = document["components"]["schemas"].as_object_mut() else { return };
    schemas.retain(|name, _| !specs.contains_key(name));
    let mut used = BTreeSet::new();
    let mut open = Vec::new();
    find_references(&document["components"], &mut open);
    find_references(&document["paths"], &mut open);
    while let Some(name) = open.pop() {
        if let Some(schema) = specs.get(&name).filter(|_| used.insert(name)) {
            find_references(schema, &mut open);
        }
    }
    specs.retain(|name, _| used.contains(name));
    if let Some(schemas) = document["components"]["schemas"].as_object_mut() {
        schemas.append(&mut specs);
    }
}

fn find_references(value: &Value, found: &mut Vec<String>) {
    match value {
        Value::Object(fields) => {
            let target = fields.get("$ref").and_then(Value::as_str);
            found.extend(target.and_then(|target| target.rsplit('/').next()).map(str::to_owned));
            fields.values().for_each(|value| find_references(value, found));
        }
        Value::Array(items) => items.iter().for_each(|value| find_references(value, found)),
        _ => {}
    }
}

/// Adds bounds of numbers in queries, from the limits that requests are checked against.
fn bound_parameters(operation: &mut Value, path: &str) {
    let page = if path.ends_with("/logs") { LOGS_MAXIMUM } else { PAGE_MAXIMUM };
    let bounds = [("limit", 1, page), ("points", 2, POINTS_MAXIMUM), ("wait", 0, LOG_WAIT_SECONDS)];
    for parameter in
        operation.get_mut("parameters").and_then(Value::as_array_mut).into_iter().flatten()
    {
        let known = bounds.iter().find(|(name, ..)| parameter["name"] == *name);
        if let Some((_, least, most)) = known {
            parameter["schema"]["minimum"] = json!(least);
            parameter["schema"]["maximum"] = json!(most);
        }
    }
}

/// Declares bodies of bytes as binary, instead of as lists of numbers.
fn declare_bytes(value: &mut Value) {
    match value {
        Value::Object(fields) => {
            if fields.get("schema").is_some_and(is_list_of_bytes) {
                fields.insert("schema".to_owned(), json!({"type": "string", "format": "binary"}));
            }
            fields.values_mut().for_each(declare_bytes);
        }
        Value::Array(items) => items.iter_mut().for_each(declare_bytes),
        _ => {}
    }
}

fn is_list_of_bytes(schema: &Value) -> bool {
    use utoipa::PartialSchema as _;
    serde_json::to_value(Vec::<u8>::schema()).is_ok_and(|bytes| bytes == *schema)
}
