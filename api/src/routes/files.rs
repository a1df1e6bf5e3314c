//! A file as an answer.

use axum::body::Body;
use axum::http::{HeaderMap, Method};
use axum::response::Response;

use crate::app::App;
use crate::app::files::Download;
use crate::download::Answer;
use crate::error::ApiError;

/// Sends a file, or the part of it that the request asks for.
pub async fn send(
    app: &App,
    method: &Method,
    headers: &HeaderMap,
    file: Download,
) -> Result<Response, ApiError> {
    let answer = Answer::new(method, headers, &file.info);
    let body = match answer.part.clone() {
        Some(part) => app.read(&file, part).await?,
        None => {
            if method == Method::HEAD {
                app.look_up(&file).await?;
            }
            Body::empty()
        }
    };
    Ok(answer.with_body(body))
}
