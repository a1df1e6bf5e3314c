//! Login with a token, and logout.

use askama::Template;
use axum::extract::{FromRequest as _, Request, State};
use axum::http::header::SET_COOKIE;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Redirect, Response};
use serde::Deserialize;

use crate::access::credentials::{SESSION_COOKIE, session};
use crate::app::App;
use crate::error::ApiError;
use crate::extract::{Form, Query};
use crate::limits::SESSION_LASTS;
use crate::page::answer::{InPage, PageError, html};
use crate::remote::Remote;

#[derive(Template)]
#[template(path = "login.html")]
struct LoginPage {
    back: String,
    was_refused: bool,
}

#[derive(Deserialize)]
pub struct ReturnQuery {
    /// The page to show after the login.
    #[serde(default)]
    back: String,
}

#[derive(Deserialize)]
pub struct Login {
    token: String,
    #[serde(default)]
    back: String,
}

/// The form for a token. A server that requires none redirects to its first page.
pub async fn show(
    State(app): State<App>,
    InPage(Query(ReturnQuery { back })): InPage<Query<ReturnQuery>>,
) -> Result<Response, PageError> {
    if app.access().is_open().await? {
        return Ok(Redirect::to("/").into_response());
    }
    Ok(html(&LoginPage { back: own_page(back), was_refused: false })?)
}

/// Opens a session and redirects to the requested page. Shows the form again if the token is not
/// valid.
///
/// # Errors
/// [`ApiError::TooManyFailures`] when the client failed too often, whatever its token is.
pub async fn log_in(State(app): State<App>, request: Request) -> Result<Response, PageError> {
    let remote = Remote::of(&request);
    if let Some(wait) = app.access().failures().wait(remote.network()) {
        return Err(ApiError::TooManyFailures { wait }.into());
    }
    let (headers, method, target) =
        (request.headers().clone(), request.method().clone(), request.uri().clone());
    let Form(Login { token, back }): Form<Login> = Form::from_request(request, &app).await?;
    let back = own_page(back);
    let Some((caller, session)) = app.access().log_in(token.trim()).await? else {
        app.access().record_failure(remote, &method, &target).await;
        let page = html(&LoginPage { back, was_refused: true })?;
        return Ok((StatusCode::UNAUTHORIZED, page).into_response());
    };
    tracing::info!(token = caller.name, "somebody logged in");
    let cookie = cookie(&session, SESSION_LASTS.as_secs(), &headers);
    Ok(([(SET_COOKIE, cookie)], Redirect::to(&back)).into_response())
}

/// Closes the session.
pub async fn log_out(State(app): State<App>, headers: HeaderMap) -> Result<Response, PageError> {
    if let Some(session) = session(&headers) {
        app.access().log_out(session).await?;
    }
    Ok(([(SET_COOKIE, cookie("", 0, &headers))], Redirect::to("/")).into_response())
}

/// A cookie that scripts cannot read and other sites cannot use. Behind a proxy with TLS, it is
/// sent only over TLS.
fn cookie(value: &str, seconds: u64, headers: &HeaderMap) -> String {
    let is_https = headers.get("x-forwarded-proto").is_some_and(|scheme| scheme == "https");
    let secure = if is_https { "; Secure" } else { "" };
    // Without a path it is valid for the folder of the login, which is the page's root, wherever a
    // proxy shows it.
    format!("{SESSION_COOKIE}={value}; Max-Age={seconds}; HttpOnly; SameSite=Lax{secure}")
}

/// The requested path, if it belongs to this server.
fn own_page(back: String) -> String {
    // A browser takes `//host` and `/\host` as another server.
    let leads_away = |rest: &str| rest.starts_with(['/', '\\']);
    let is_path = back.strip_prefix('/').is_some_and(|rest| !leads_away(rest));
    let is_plain = back.bytes().all(|byte| byte.is_ascii_graphic());
    if is_path && is_plain { back } else { "/".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_login_leads_back_to_this_server_alone() {
        for page in ["/", "/jobs/1", "/?job=3&x=//y"] {
            assert_eq!(own_page(page.to_owned()), page);
        }
        for elsewhere in [
            "",
            "//evil.example",
            "/\\evil.example",
            "https://evil.example",
            "jobs/1",
            "/\r\nx: y",
            "é",
            "/é",
            "€/",
        ] {
            assert_eq!(own_page(elsewhere.to_owned()), "/", "{elsewhere}");
        }
    }
}
