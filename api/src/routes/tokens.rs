//! Tokens for access to the server.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use wire::{CreatedToken, NewToken, Token, Tokens};

use crate::app::App;
use crate::error::ApiError;
use crate::extract::{JsonBytes, Path};

/// List all tokens, including revoked and expired ones, oldest first.
#[utoipa::path(
    get,
    path = "/v1/tokens",
    tag = "access",
    security((), ("token" = ["admin"])),
    responses((status = 200, body = Tokens)),
)]
pub async fn list(State(app): State<App>) -> Result<Json<Tokens>, ApiError> {
    Ok(Json(app.tokens().await?))
}

/// Create a token.
///
/// Only this answer shows the token. From the first token on, the server requires one.
#[utoipa::path(
    post,
    path = "/v1/tokens",
    tag = "access",
    security((), ("token" = ["admin"])),
    request_body = NewToken,
    responses((status = 201, body = CreatedToken)),
)]
pub async fn create(
    State(app): State<App>,
    JsonBytes(body): JsonBytes,
) -> Result<(StatusCode, Json<CreatedToken>), ApiError> {
    let asked: NewToken = app.read_body(body, ApiError::NewToken).await?;
    Ok((StatusCode::CREATED, Json(app.create_token(&asked).await?)))
}

/// Revoke a token.
///
/// It stops working on this server at once, and on other servers with the same database within 5 s.
#[utoipa::path(
    delete,
    path = "/v1/tokens/{id}",
    tag = "access",
    security((), ("token" = ["admin"])),
    params(("id" = i64, Path)),
    responses((status = 200, body = Token)),
)]
pub async fn revoke(State(app): State<App>, Path(id): Path<i64>) -> Result<Json<Token>, ApiError> {
    Ok(Json(app.revoke_token(id).await?))
}
