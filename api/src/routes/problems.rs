//! The errors of each operation, for the OpenAPI document.

use serde_json::{Value, json};

use crate::limits::{HEAD_BYTES, HEAD_FIELDS};

/// Errors that depend only on the operation.
const OF_OPERATIONS: [(&str, &str, &[u16]); 11] = [
    ("post", "/v1/jobs", &[409, 410, 422, 507]),
    ("post", "/v1/jobs/{id}/retry", &[409, 422, 507]),
    ("post", "/v1/jobs/{id}/cancel", &[409]),
    ("post", "/v1/datasets", &[409, 410, 422, 507]),
    ("post", "/v1/robots", &[422, 507]),
    ("post", "/v1/datasets/{id}/verify", &[409, 422, 507]),
    ("post", "/v1/checkpoints/{id}/predict", &[422, 501, 507]),
    ("post", "/v1/checkpoints/{id}/torque", &[422, 501, 507]),
    ("get", "/v1/datasets/{id}/trajectories/{index}/predictions", &[422, 501, 507]),
    ("post", "/v1/tokens", &[409, 422]),
    ("get", "/v1/checkpoints/{id}/stream", &[403, 422, 426, 501, 507]),
];

/// Errors of every request.
const OF_ALL: [u16; 5] = [400, 421, 429, 500, 503];

/// Path prefixes of resources that can be deleted, and of their parts.
const DELETABLE: [&str; 6] = [
    "/v1/jobs/{id}",
    "/v1/runs/{id}",
    "/v1/datasets/{id}",
    "/v1/checkpoints/{id}",
    "/v1/evaluations/{id}",
    "/v1/attempts/{id}",
];

/// Errors of requests with a body.
const OF_BODIES: [u16; 4] = [400, 408, 413, 415];

/// Adds the possible errors of an operation.
pub fn add(operation: &mut Value, method: &str, path: &str) {
    let mut statuses = OF_ALL.to_vec();
    let is_open = operation["security"]
        .as_array()
        .is_some_and(|requirements| requirements.contains(&json!({})))
        && !operation["security"].to_string().contains("token");
    if !is_open {
        statuses.push(401);
    }
    let needs_more = ["submit", "admin"]
        .iter()
        .any(|scope| operation["security"].to_string().contains(&format!("\"{scope}\"")));
    if method != "get" || needs_more {
        statuses.push(403);
    }
    if path.contains('{') {
        statuses.push(404);
    }
    if DELETABLE.iter().any(|deletable| path.starts_with(deletable)) {
        statuses.push(410);
        match method {
            "patch" => statuses.extend([409, 422]),
            "delete" => statuses.push(409),
            _ if path.ends_with("/restore") => statuses.push(409),
            _ => {}
        }
    }
    if operation.get("requestBody").is_some() {
        statuses.extend(OF_BODIES);
    }
    for (of_method, of_path, own) in OF_OPERATIONS {
        if (of_method, of_path) == (method, path) {
            statuses.extend(own);
        }
    }
    let schema = json!({"$ref": "#/components/schemas/Problem"});
    for status in statuses {
        operation["responses"][status.to_string()] = json!({
            "description": meaning(status),
            "content": {"application/problem+json": {"schema": schema}},
        });
    }
    // They are refused before they are read, so the answers have no body.
    operation["responses"]["414"] =
        json!({"description": format!("The address has almost {} KiB or more", HEAD_BYTES >> 10)});
    operation["responses"]["431"] = json!({
        "description": format!(
            "The head of the request has more than {} KiB or {HEAD_FIELDS} fields", HEAD_BYTES >> 10
        ),
    });
}

fn meaning(status: u16) -> &'static str {
    match status {
        400 => "A parameter, or the body, cannot be read",
        401 => "A token is required",
        403 => "The token's scope is too small, or the request came from another site",
        404 => "There is no such resource",
        408 => "The body did not arrive in time",
        409 => "The state of the resource does not allow it",
        410 => "It was deleted; the problem says how to restore it",
        413 => "The body is too large",
        415 => "The body has the wrong media type",
        421 => "The server does not have this name",
        422 => "The body or the labels are not allowed; `violations` names every field",
        426 => "The path needs a WebSocket",
        429 => {
            "Too many requests per second, or too many wrong tokens; `Retry-After` says when to try again"
        }
        501 => "The server has no models for predictions",
        503 => "Too many requests at once, or the database cannot be written",
        507 => "There is no room for it",
        _ => "The server failed",
    }
}
