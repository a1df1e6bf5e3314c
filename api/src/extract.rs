//! Extractors of axum that answer rejections with problems.

use std::convert::Infallible;

use axum::body::{Body, Bytes};
use axum::extract::rejection::{BytesRejection, PathRejection, QueryRejection};
use axum::extract::{DefaultBodyLimit, FromRef, FromRequest, FromRequestParts, Request};
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode};
use axum::response::IntoResponse;
use serde::de::DeserializeOwned;

use crate::checks::{Checks, QuestionMemory};
use crate::error::ApiError;
use crate::limits::{BODY_BYTES, BODY_WITHIN, FORM_BYTES, IDEMPOTENCY_KEY_BYTES, QUESTION_BYTES};

/// The variables of a path.
pub struct Path<T>(pub T);

impl<T, S> FromRequestParts<S> for Path<T>
where
    T: DeserializeOwned + Send,
    S: Send + Sync,
{
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let captures: Result<axum::extract::Path<T>, PathRejection> =
            axum::extract::Path::from_request_parts(parts, state).await;
        match captures {
            Ok(axum::extract::Path(captures)) => Ok(Self(captures)),
            Err(_) => Err(ApiError::parameter("path", parts.uri.path(), "ids are whole numbers")),
        }
    }
}

/// The query string. Unknown parameters were refused before.
pub struct Query<T>(pub T);

impl<T, S> FromRequestParts<S> for Query<T>
where
    T: DeserializeOwned + Send,
    S: Send + Sync,
{
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let query: Result<axum::extract::Query<T>, QueryRejection> =
            axum::extract::Query::from_request_parts(parts, state).await;
        match query {
            Ok(axum::extract::Query(query)) => Ok(Self(query)),
            Err(rejection) => {
                Err(unreadable_query(parts.uri.query().unwrap_or_default(), &rejection.body_text()))
            }
        }
    }
}

/// The error for a query that could not be read. `rejection` is axum's text, which ends with the
/// parameter and the reason.
fn unreadable_query(query: &str, rejection: &str) -> ApiError {
    let reason = rejection.split_once(": ").map_or(rejection, |(_, reason)| reason);
    let mut pairs = form_urlencoded::parse(query.as_bytes());
    let found = reason.split_once(": ").and_then(|(field, reason)| {
        let (_, value) = pairs.find(|(name, _)| name == field)?;
        Some((field, value, reason))
    });
    let Some((field, value, reason)) = found else {
        return ApiError::Query { reason: reason.to_owned() };
    };
    let allowed = if reason.contains("`true` or `false`") {
        "true or false".to_owned()
    } else if reason.contains("digit") || reason.contains("integer") || reason.contains("number") {
        "a whole number in its range".to_owned()
    } else {
        match reason.split_once("expected ") {
            Some((_, allowed)) => allowed.replace('`', ""),
            None => reason.to_owned(),
        }
    };
    ApiError::parameter(field, value, allowed)
}

/// The parameters of a query, in order. A name may come several times.
pub struct QueryPairs(pub Vec<(String, String)>);

impl<S: Send + Sync> FromRequestParts<S> for QueryPairs {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        let query = parts.uri.query().unwrap_or_default();
        Ok(Self(form_urlencoded::parse(query.as_bytes()).into_owned().collect()))
    }
}

impl QueryPairs {
    /// All values of `tag`.
    pub fn tags(self) -> Vec<String> {
        let tags = self.0.into_iter().filter(|(name, _)| name == "tag");
        tags.map(|(_, tag)| tag).collect()
    }

    /// The fields of a form, without empty ones and with one field per tag.
    pub fn filled(self) -> Vec<(String, String)> {
        let mut filled = Vec::new();
        for (name, value) in self.0 {
            if name == "tag" {
                let tags = value.split([' ', ',']).filter(|tag| !tag.is_empty());
                filled.extend(tags.map(|tag| (name.clone(), tag.to_owned())));
            } else if !value.trim().is_empty() {
                filled.push((name, value));
            }
        }
        filled
    }
}

/// A body that is declared as JSON, with at most `LIMIT` bytes.
pub struct JsonBytes<const LIMIT: usize = BODY_BYTES>(pub Bytes);

impl<S: Send + Sync, const LIMIT: usize> FromRequest<S> for JsonBytes<LIMIT> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &S) -> Result<Self, ApiError> {
        require_json(request.headers(), &[JSON])?;
        read(request, state, LIMIT).await.map(Self)
    }
}

/// A question to a model, and the memory that it takes while it is answered.
pub struct QuestionBytes {
    pub body: Bytes,
    pub memory: QuestionMemory,
}

impl<S: Send + Sync> FromRequest<S> for QuestionBytes
where
    Checks: FromRef<S>,
{
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &S) -> Result<Self, ApiError> {
        let length = request.headers().get(CONTENT_LENGTH).and_then(|length| length.to_str().ok());
        let declared = length.and_then(|length| length.parse().ok()).unwrap_or(QUESTION_BYTES);
        let memory = Checks::from_ref(state).memory(declared.min(QUESTION_BYTES))?;
        let JsonBytes(body) = JsonBytes::<QUESTION_BYTES>::from_request(request, state).await?;
        Ok(Self { body, memory })
    }
}

/// A robot: a URDF that is declared as XML, or a description that is declared as JSON.
pub enum RobotText {
    /// A URDF.
    Urdf(Bytes),
    /// A description.
    Description(Bytes),
}

impl<S: Send + Sync> FromRequest<S> for RobotText {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &S) -> Result<Self, ApiError> {
        let declared = declared(request.headers());
        let is_any = |types: &[&str]| {
            let essence = declared.as_deref().map(essence);
            types.iter().any(|known| essence.is_some_and(|found| found.eq_ignore_ascii_case(known)))
        };
        if is_any(&["application/xml", "text/xml"]) {
            return read(request, state, urdf::MAX_BYTES).await.map(Self::Urdf);
        }
        if is_any(&[JSON]) {
            return read(request, state, BODY_BYTES).await.map(Self::Description);
        }
        Err(ApiError::RobotType { found: declared })
    }
}

/// A body that is declared as a merge patch (RFC 7396) or as JSON.
pub struct PatchBytes(pub Bytes);

impl<S: Send + Sync> FromRequest<S> for PatchBytes {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &S) -> Result<Self, ApiError> {
        require_json(request.headers(), &[JSON, "application/merge-patch+json"])?;
        read(request, state, BODY_BYTES).await.map(Self)
    }
}

/// The fields of a form of the page, with at most `LIMIT` bytes.
pub struct Form<T, const LIMIT: usize = FORM_BYTES>(pub T);

impl<T: DeserializeOwned + Send, S: Send + Sync, const LIMIT: usize> FromRequest<S>
    for Form<T, LIMIT>
{
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &S) -> Result<Self, ApiError> {
        let request = received(request, LIMIT).await?;
        let form = axum::extract::Form::from_request(request, state).await;
        match form {
            Ok(axum::extract::Form(fields)) => Ok(Self(fields)),
            Err(rejection) => Err(ApiError::Form { reason: rejection.body_text() }),
        }
    }
}

/// The same request, once its body of at most `limit` bytes has arrived.
///
/// # Errors
/// When the body is larger, or does not arrive in time.
pub async fn received(request: Request, limit: usize) -> Result<Request, ApiError> {
    let (parts, body) = request.into_parts();
    let bytes = read(Request::new(body), &(), limit).await?;
    Ok(Request::from_parts(parts, Body::from(bytes)))
}

const JSON: &str = "application/json";

async fn read<S: Send + Sync>(
    mut request: Request,
    state: &S,
    limit: usize,
) -> Result<Bytes, ApiError> {
    DefaultBodyLimit::max(limit).apply(&mut request);
    let body = tokio::time::timeout(BODY_WITHIN, Bytes::from_request(request, state));
    match body.await {
        Ok(Ok(bytes)) => Ok(bytes),
        Ok(Err(rejection)) => Err(unreadable(rejection, limit)),
        Err(_) => Err(ApiError::SlowBody),
    }
}

fn unreadable(rejection: BytesRejection, limit: usize) -> ApiError {
    let reason = rejection.body_text();
    if rejection.into_response().status() == StatusCode::PAYLOAD_TOO_LARGE {
        return ApiError::BodyTooLarge { limit };
    }
    ApiError::Body { reason }
}

/// The declared media type, with its parameters.
fn declared(headers: &HeaderMap) -> Option<String> {
    let declared = headers.get(CONTENT_TYPE)?;
    Some(String::from_utf8_lossy(declared.as_bytes()).into_owned())
}

/// The media type without its parameters.
fn essence(declared: &str) -> &str {
    declared.split(';').next().unwrap_or("").trim()
}

fn require_json(headers: &HeaderMap, types: &[&str]) -> Result<(), ApiError> {
    let Some(found) = declared(headers) else {
        return Err(ApiError::ContentType { found: "of no declared type".to_owned() });
    };
    if types.iter().any(|known| essence(&found).eq_ignore_ascii_case(known)) {
        return Ok(());
    }
    Err(ApiError::ContentType { found: format!("declared as {found}") })
}

/// The `Idempotency-Key` header, if any.
pub struct IdempotencyKey(pub Option<String>);

impl<S: Send + Sync> FromRequestParts<S> for IdempotencyKey {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, ApiError> {
        let Some(value) = parts.headers.get("idempotency-key") else { return Ok(Self(None)) };
        let key = value.to_str().unwrap_or("");
        if key.is_empty() || key.len() > IDEMPOTENCY_KEY_BYTES {
            return Err(ApiError::parameter(
                "Idempotency-Key",
                String::from_utf8_lossy(value.as_bytes()),
                format!("1 to {IDEMPOTENCY_KEY_BYTES} printable ASCII characters"),
            ));
        }
        Ok(Self(Some(key.to_owned())))
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[expect(dead_code, reason = "only the errors are looked at")]
    struct Parameters {
        force: Option<bool>,
        limit: Option<u32>,
        form: Option<Form>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Form {
        Json,
        Arrow,
    }

    async fn refused(query: &str) -> String {
        let uri = format!("/v1/jobs?{query}");
        let (mut parts, ()) = axum::http::Request::get(uri).body(()).unwrap().into_parts();
        let read = Query::<Parameters>::from_request_parts(&mut parts, &()).await;
        read.err().unwrap().to_string()
    }

    #[tokio::test]
    async fn a_parameter_that_cannot_be_read_is_named_with_its_value_and_what_is_allowed() {
        let whole = "allowed: a whole number in its range";
        for (query, message) in [
            ("force=yes", "force is \"yes\", allowed: true or false"),
            ("force=true&limit=x", &format!("limit is \"x\", {whole}")),
            ("limit=-1", &format!("limit is \"-1\", {whole}")),
            ("limit=", &format!("limit is \"\", {whole}")),
            ("limit=99999999999", &format!("limit is \"99999999999\", {whole}")),
            ("form=csv", "form is \"csv\", allowed: json or arrow"),
        ] {
            assert_eq!(refused(query).await, message);
        }
        assert!(refused("force=true&force=true").await.contains("duplicate field `force`"));
    }
}
