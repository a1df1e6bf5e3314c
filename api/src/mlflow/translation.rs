//! Puts errors of the guards, which stand before every path, into MLflow's form for its clients.

use axum::body::Body;
use axum::extract::Request;
use axum::http::HeaderValue;
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE};
use axum::middleware::Next;
use axum::response::Response;
use serde_json::json;
use wire::Problem;

use super::ErrorCode;

/// The prefix of paths for MLflow's clients.
const PREFIX: &str = "/api/";

/// Writes a problem as `error_code` and `message`, with its status and headers.
pub async fn translate(request: Request, next: Next) -> Response {
    let is_mlflow = request.uri().path().starts_with(PREFIX);
    let response = next.run(request).await;
    let problem = response.extensions().get::<Problem>().filter(|_| is_mlflow);
    let Some(problem) = problem.cloned() else { return response };
    let code = ErrorCode::of_status(response.status()).as_str();
    let body = json!({"error_code": code, "message": problem.detail}).to_string();
    let (mut parts, _) = response.into_parts();
    parts.headers.insert(CONTENT_TYPE, HeaderValue::from_static("application/json"));
    parts.headers.remove(CONTENT_LENGTH);
    Response::from_parts(parts, Body::from(body))
}
